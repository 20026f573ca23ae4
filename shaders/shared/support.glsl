// Supports: conditions on the motion of nodes, which may be left a plane, a line, or nothing. What is left to a node is
// a vec4 (`left` of Supported in shared/types.glsl): the unit normal of the plane, or the unit direction of the line, in
// world axes; and, in w, one of the values below. The change of velocity x of a supported node is S x, with the
// projection S onto what is left to it, so that the system of equations becomes S A S x = S b; what S takes from
// A x - b is the impulse that holds the node. A node that follows a core of prescribed motion (a rigid body inside a soft one) is left nothing, if the force that
// holds it is to be reported. The f64 reference is oracle::step.

const uint SUPPORT_NONE = 0;        // the node is free, or no force that holds it is reported
const uint SUPPORT_PLANE = 1;       // it moves in a plane
const uint SUPPORT_AXIS = 2;        // it moves along a line
const uint SUPPORT_HELD = 3;        // it does not move, or moves with its core only

// S v.
vec3 along_support(vec4 support, vec3 v) {
    uint kind = uint(support.w);
    if (kind == SUPPORT_NONE) return v;
    if (kind == SUPPORT_HELD) return vec3(0.0);
    vec3 across = dot(support.xyz, v) * support.xyz;
    return kind == SUPPORT_PLANE ? v - across : across;
}

// |S| e, with the magnitudes of the entries of S: a bound of the rounding error of S b, where `e` sums the magnitudes of
// the terms of b.
vec3 magnitudes_along_support(vec4 support, vec3 e) {
    uint kind = uint(support.w);
    if (kind == SUPPORT_NONE) return e;
    if (kind == SUPPORT_HELD) return vec3(0.0);
    vec3 n = abs(support.xyz), across = dot(n, e) * n;
    return kind == SUPPORT_PLANE ? across + (1.0 - 2.0 * n * n) * e : across;
}

// Makes S A S of a symmetric matrix of a node, with diagonal `a` and off-diagonal (xy xz yz) `c`. `fill` is added along the
// directions that the node does not have, so that the matrix can be inverted.
void restrict_block(vec4 support, float fill, inout vec3 a, inout vec3 c) {
    if (uint(support.w) == SUPPORT_NONE) return;
    mat3 block = mat3(a.x, c.x, c.y, c.x, a.y, c.z, c.y, c.z, a.z), s;
    for (int k = 0; k < 3; k++) s[k] = along_support(support, vec3(k == 0, k == 1, k == 2));
    block = s * block * s + fill * (mat3(1.0) - s);
    a = vec3(block[0][0], block[1][1], block[2][2]);
    c = vec3(block[1][0], block[2][0], block[2][1]);
}
