// Geometric stiffness of a tetrahedron: the part of its stiffness with which a stretched material resists rotation, as
// a taut string does. With the change of velocity p_i of its nodes and the gradients g'_i of the solver's operator
// (elastic/element_forces), W = sum p_i g'_i^T, and the vector w = sum g'_i x p_i is twice the axial vector of the skew
// part of W. The quadratic form w^T Z w adds to the operator; its force on node i is (Z w) x g'_i. Z is symmetric and
// positive semi-definite: h^2 / 4 times the geometric stiffness of the material law (shared/material_law.glsl), with the
// step h, turned into world axes.
//
// In the array `gradients` a tetrahedron has GRADIENT_TEXELS vectors: g' of its last three nodes, then the diagonal
// xx yy zz of Z, and its other entries xy xz yz. An including shader includes shared/symmetric.glsl.

const uint GRADIENT_TEXELS = 5;

// Sum of g'_i x p_i for W = sum p_i g'_i^T.
vec3 twice_axial(mat3 w) {
    return vec3(w[1][2] - w[2][1], w[2][0] - w[0][2], w[0][1] - w[1][0]);
}

// The matrix whose product with v is a x v.
mat3 cross_matrix(vec3 a) {
    return mat3(0.0, a.z, -a.y, -a.z, 0.0, a.x, a.y, -a.x, 0.0);
}

// Stress, times the volume and the square of the step, that the geometric stiffness with the given entries adds.
mat3 geometric_stress(mat3 w, vec3 diagonal, vec3 off) {
    return cross_matrix(symmetric_times(diagonal, off, twice_axial(w)));
}

// Adds a node's 3x3 block of the geometric stiffness, [g]^T Z [g] with [g] the cross product matrix of its gradient g:
// xx yy zz to `a`, xy xz yz to `c`.
void add_geometric_block(vec3 g, vec3 diagonal, vec3 off, inout vec3 a, inout vec3 c) {
    vec3 square = g * g, yz = g.yxx * g.zzy;        // yz: products of the other two components
    a += diagonal.yxx * square.zzy + diagonal.zzy * square.yxx - 2.0 * off.zyx * yz;
    c += vec3(off.y * yz.x + off.z * yz.y - off.x * square.z - diagonal.z * yz.z,
        off.x * yz.x + off.z * yz.z - off.y * square.y - diagonal.y * yz.y,
        off.x * yz.y + off.y * yz.z - off.z * square.x - diagonal.x * yz.x);
}
