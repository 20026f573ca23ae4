#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"
#include "shared/rows.glsl"

// Solve: assembles the elements' part of the operator. An edge is a pair of nodes i < j that share a tetrahedron. The
// kernel writes the 3x3 blocks K_ij and K_ji of each edge: K_ij is the sum over its tetrahedra of mu ((g_i . g_j) I +
// g_j g_i^T) + lambda g_i g_j^T + [g_i]^T Z [g_j], with the gradients g' of the solver's operator and the moduli mu
// and lambda that elastic/element_forces computes, the matrix Z of the geometric stiffness (shared/geometric.glsl),
// and the cross product matrix [g] of g. K_ji is its transpose. Since a translation causes no force, the blocks of a
// row sum to zero, and the product with a change of velocity p is sum K_ij (p_j - p_i), for which solve/gather needs
// no K_ii. One invocation runs for each edge. The f64 reference is oracle::elastic::Elements::apply_stiffness.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint EDGES = 0;

READ_ONLY(uvec4, edges);            // first entry in `edge_elements`, number of entries, first texels of K_ij and K_ji
READ_ONLY(uvec4, edge_elements);    // four entries per texel: 16 * tetrahedron + 4 * corner i + corner j
READ_ONLY(vec4, gradients);         // GRADIENT_TEXELS per tetrahedron; w of the first: mu, of the second: lambda
layout(scalar) writeonly buffer StiffnessBlocks { vec4 stiffness_blocks[]; };      // rows, shared/rows.glsl

vec3 gradient_of(uint corner, vec3 g1, vec3 g2, vec3 g3) {
    return corner == 0 ? -g1 - g2 - g3 : (corner == 1 ? g1 : (corner == 2 ? g2 : g3));
}

// Writes a block at its first texel, if there is one; the components w are left as they are.
void write_block(uint first, mat3 block) {
    if (first == NONE) return;
    for (int c = 0; c < 3; c++) stiffness_blocks[row_texel(first, 0, c)].xyz = block[c];
}

void main() {
    uint e = gl_GlobalInvocationID.x;
    if (e >= EDGES) return;
    uvec4 edge = fetch(edges, e);
    mat3 sum = mat3(0.0);
    for (uint k = edge.x; k < edge.x + edge.y; k++) {
        uint entry = fetch(edge_elements, k / 4)[k % 4];
        uint first = GRADIENT_TEXELS * (entry / 16);
        vec4 g1 = fetch(gradients, first), g2 = fetch(gradients, first + 1);
        vec3 g3 = fetch(gradients, first + 2).xyz;
        vec3 diagonal = fetch(gradients, first + 3).xyz, off = fetch(gradients, first + 4).xyz;
        vec3 gi = gradient_of(entry / 4 % 4, g1.xyz, g2.xyz, g3), gj = gradient_of(entry % 4, g1.xyz, g2.xyz, g3);
        float both = g1.w * dot(gi, gj);
        sum += g1.w * outerProduct(gj, gi) + g2.w * outerProduct(gi, gj) + mat3(both, 0, 0, 0, both, 0, 0, 0, both);
        mat3 turned = cross_matrix(gj);
        for (int c = 0; c < 3; c++) sum[c] += cross(symmetric_times(diagonal, off, turned[c]), gi);
    }
    write_block(edge.z, sum);
    write_block(edge.w, transpose(sum));
}
