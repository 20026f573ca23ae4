#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"

// Draw stage (for display and export, not part of a step): strain energy density of each tetrahedron at its present
// displacements, by its material law (shared/material_law.glsl), and, where STRESS is set, Cauchy's stress P F^T / det F,
// with the deformation gradient F and the law's first Piola-Kirchhoff stress P. Both contain the compression penalty;
// damping is left out. A tetrahedron that is flat or inside out has no such stress, and zero is written for it.
//
// Where Lame's first parameter lambda may act through F-bar patches (groups of tetrahedra with one volumetric strain), two
// passes are needed. The first one, without STRESS, writes the densities, and draw/share adds lambda's part to them and
// leaves its part of P. The second one, with STRESS, reads that part.
//
// The rotations of the last step only serve as the first guess of the polar decomposition of F. One invocation runs for
// each tetrahedron. The f64 reference implementations are oracle::elastic::Elements::densities and stresses. A frame is
// a rigid coordinate frame, a link the relative placement of two frames.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;
layout(constant_id = 2) const bool SPANS = false;       // whether a tetrahedron may have nodes in several frames
layout(constant_id = 3) const bool PATCHES = false;     // whether lambda may act through F-bar patches
layout(constant_id = 4) const uint LAWS = 1;            // a bit for each material law in use
layout(constant_id = 5) const bool STRESS = false;      // whether to compute stresses too

layout(scalar) readonly buffer Materials { ElasticMaterial materials[]; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, rest_gradients);       // three per tetrahedron; w of the first: square root of the rest volume
layout(scalar) readonly buffer ElementInfo { uvec2 element_info[]; };    // material and frame of each tetrahedron
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, tetrahedron_links);  // links from the first node's frame to each node's frame; 0: the same frame
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, links);            // between frames, as they are now
layout(scalar) readonly buffer PatchOf { uint patch_of[]; };       // patch of each tetrahedron, or NONE
READ_ONLY(vec4, rotations);
// J/m^3; volume, m^3; tr(strain); lambda where a patch applies it, Pa. After draw/share the last one is the patch's part
// of the stress, Pa.
layout(scalar) buffer Densities { vec4 densities[]; };
// Two per tetrahedron, world axes, Pa: xx, yy, zz and von Mises's stress; xy, xz, yz and the pressure max(0, -trace / 3).
layout(scalar) writeonly buffer Stresses { vec4 stresses[]; };

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
    vec4 q = polar(mat3(1.0) + g, fetch(rotations, t), lost);
    mat3 e = strain(q, g), compression = excess_compression(e);
    float shared_lambda = PATCHES && patch_of[t] != NONE ? material.lambda : 0.0;
    float own_lambda = material.lambda - shared_lambda;
    if (!(STRESS && PATCHES)) {
        densities[t] = vec4(energy_density(material, e, compression, own_lambda), g1.w * g1.w, trace(e), shared_lambda);
    }
    if (!STRESS) return;
    mat3 stretch = mat3(1.0) + e, piola = evaluate(material, e, compression, own_lambda).stress;
    if (PATCHES && patch_of[t] != NONE) piola += mat3(densities[t].w);
    float volume = determinant(stretch);
    mat3 cauchy = volume > 0.0 ? even_part(piola * transpose(stretch)) / volume : mat3(0.0);
    vec4 world = compose(frames[element_info[t].y].rotation, q);
    for (int k = 0; k < 3; k++) cauchy[k] = rotate(world, cauchy[k]);
    cauchy = transpose(cauchy);
    for (int k = 0; k < 3; k++) cauchy[k] = rotate(world, cauchy[k]);
    vec3 diagonal = vec3(cauchy[0][0], cauchy[1][1], cauchy[2][2]);
    vec3 off = vec3(cauchy[0][1], cauchy[0][2], cauchy[1][2]);
    vec3 differences = diagonal - diagonal.yzx;
    float von_mises = sqrt(0.5 * dot(differences, differences) + 3.0 * dot(off, off));
    stresses[2 * t] = vec4(diagonal, von_mises);
    stresses[2 * t + 1] = vec4(off, max(0.0, -(diagonal.x + diagonal.y + diagonal.z) / 3.0));
}
