#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Solve: product of the F-bar patches' part of the operator with a change of velocity p. An F-bar patch is a group of
// tetrahedra that share one volumetric strain (elastic/mean_dilatation). A patch's product is c (c . p), where its row
// c is the gradient of the shared strain with respect to the patch's nodes, scaled (shared/f_bar_patch.glsl). The
// kernel runs concurrently with solve/element_product. It is a kernel of its own because some devices run the untaken
// branches of a common kernel with lanes masked: on lavapipe (Vulkan on CPUs) an iteration with 10,368 tetrahedra took
// 130 us with two kernels, but 350 us with one. One invocation runs for each patch. The f64 reference is
// oracle::elastic::Elements::patch_rows.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PATCHES = 0;
layout(constant_id = 2) const uint TETRAHEDRA = 0;

READ_ONLY(uvec4, patch_nodes);     // three texels per patch: its nodes, padded with the first node
READ_ONLY(vec4, patch_rows);       // c, from elastic/mean_dilatation
READ_ONLY(vec4, change);
layout(scalar) writeonly buffer ElementForces { vec4 element_forces[]; };

#include "shared/f_bar_patch.glsl"

// Fetches four entries of the row c of patch `p`, and returns their part of the product of c with the nodes' changes of
// velocity relative to that of the patch's first node, `p0`. The entries are separate variables, because an array that
// a loop indexes may be kept in slow memory.
float patch_part(uint p, uint q, vec3 p0, out vec3 c0, out vec3 c1, out vec3 c2, out vec3 c3) {
    uvec4 nodes = patch_quad(p, q);
    c0 = fetch(patch_rows, patch_row(p, 4 * q)).xyz;
    c1 = fetch(patch_rows, patch_row(p, 4 * q + 1)).xyz;
    c2 = fetch(patch_rows, patch_row(p, 4 * q + 2)).xyz;
    c3 = fetch(patch_rows, patch_row(p, 4 * q + 3)).xyz;
    return dot(c0, fetch(change, nodes.x).xyz - p0) + dot(c1, fetch(change, nodes.y).xyz - p0)
        + dot(c2, fetch(change, nodes.z).xyz - p0) + dot(c3, fetch(change, nodes.w).xyz - p0);
}

// Writes the forces on four nodes of a patch; returns their sum.
vec3 patch_forces(uint p, uint q, vec3 f0, vec3 f1, vec3 f2, vec3 f3) {
    element_forces[patch_entry(p, 4 * q)] = vec4(f0, 0.0);
    element_forces[patch_entry(p, 4 * q + 1)] = vec4(f1, 0.0);
    element_forces[patch_entry(p, 4 * q + 2)] = vec4(f2, 0.0);
    element_forces[patch_entry(p, 4 * q + 3)] = vec4(f3, 0.0);
    return f0 + f1 + f2 + f3;
}

// The entries of a row sum to zero, so a velocity common to all nodes gives no force. This holds exactly in f32, since
// changes of velocity relative to the first node are used.
void main() {
    uint p = gl_GlobalInvocationID.x;
    if (p >= PATCHES) return;
    vec3 p0 = fetch(change, patch_quad(p, 0).x).xyz;
    vec3 c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10, c11;
    float along = patch_part(p, 0, p0, c0, c1, c2, c3) + patch_part(p, 1, p0, c4, c5, c6, c7)
        + patch_part(p, 2, p0, c8, c9, c10, c11);
    vec3 others = patch_forces(p, 1, along * c4, along * c5, along * c6, along * c7)
        + patch_forces(p, 2, along * c8, along * c9, along * c10, along * c11);
    vec3 f1 = along * c1, f2 = along * c2, f3 = along * c3;
    // The first node's force is minus the sum of all others, so that the forces sum to zero.
    patch_forces(p, 0, -(f1 + f2 + f3 + others), f1, f2, f3);
}
