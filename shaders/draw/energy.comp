#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"

// Draw stage (for display, not part of a step): strain energy density of each tetrahedron at its present displacements,
// by its material law (shared/material_law.glsl). Where Lame's first parameter lambda acts through F-bar patches
// (groups of tetrahedra with one volumetric strain), draw/share adds lambda's part of the energy. The rotations of the
// last step only serve as the first guess of the polar decomposition of the deformation gradient. One invocation runs
// for each tetrahedron. The f64 reference implementation is oracle::elastic::Elements::densities. A frame is a rigid
// coordinate frame, a link the relative placement of two frames.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;
layout(constant_id = 2) const bool SPANS = false;       // whether a tetrahedron may have nodes in several frames
layout(constant_id = 3) const bool PATCHES = false;     // whether lambda may act through F-bar patches
layout(constant_id = 4) const uint LAWS = 1;            // a bit for each material law in use

layout(scalar) readonly buffer Materials { ElasticMaterial materials[]; };
READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, rest_gradients);       // three per tetrahedron; w of the first: square root of the rest volume
layout(scalar) readonly buffer ElementInfo { uvec2 element_info[]; };    // material and frame of each tetrahedron
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, tetrahedron_links);  // links from the first node's frame to each node's frame; 0: the same frame
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer Links { Link links[]; };            // between frames, as they are now
layout(scalar) readonly buffer PatchOf { uint patch_of[]; };       // patch of each tetrahedron, or NONE
READ_ONLY(vec4, rotations);
layout(scalar) writeonly buffer Densities { vec4 densities[]; };  // J/m^3; volume, m^3; tr(strain); patch's lambda, Pa

#include "shared/strain.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"
#include "shared/material_law.glsl"
#include "shared/link.glsl"
#include "shared/element.glsl"

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TETRAHEDRA) return;
    uvec4 nodes = fetch(tetrahedra, t);
    vec4 g1 = fetch(rest_gradients, 3 * t), g2 = fetch(rest_gradients, 3 * t + 1),
        g3 = fetch(rest_gradients, 3 * t + 2);
    ElasticMaterial material = materials[element_info[t].x];
    uvec4 link = SPANS ? fetch(tetrahedron_links, t) : uvec4(0);
    mat3 g = displacement_gradient(nodes, link, g1.xyz, g2.xyz, g3.xyz);
    bool lost;
    mat3 e = strain(polar(mat3(1.0) + g, fetch(rotations, t), lost), g);
    float shared_lambda = PATCHES && patch_of[t] != NONE ? material.lambda : 0.0;
    float density = energy_density(material, e, excess_compression(e), material.lambda - shared_lambda);
    densities[t] = vec4(density, g1.w * g1.w, trace(e), shared_lambda);
}
