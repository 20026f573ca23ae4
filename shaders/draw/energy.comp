#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"
#include "shared/squeeze.glsl"
#include "shared/link.glsl"
#include "shared/neo_hookean.glsl"

// Draw: strain energy density of each tetrahedron as it is now, by its law (elastic/rotate): corotational
// mu |sym E|^2 + lambda / 2 tr(E)^2, neo-Hookean as in shared/neo_hookean.glsl, and of squeezed axes half of their stiffness
// times the square. The part of lambda that acts by patches is added by draw/share. The step's rotations are only where the
// search for these begins. One invocation a tetrahedron. Oracle: oracle::elastic::Elements::densities.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;
layout(constant_id = 2) const bool SPANS = false;       // as in elastic/rotate
layout(constant_id = 3) const bool PATCHES = false;
layout(constant_id = 4) const bool NEO_HOOKEAN = false;

layout(scalar) readonly buffer Materials { vec4 materials[]; };     // mu, lambda (Pa), law; a material
READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, rest_gradients);       // three a tetrahedron; w of the first: sqrt(V)
layout(scalar) readonly buffer ElementInfo { uvec2 element_info[]; };    // material, frame; a tetrahedron
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, tetrahedron_links);
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer Links { Link links[]; };            // between frames as they are now
layout(scalar) readonly buffer PatchOf { uint patch_of[]; };
READ_ONLY(vec4, rotations);
layout(scalar) writeonly buffer Densities { vec4 densities[]; };   // J/m^3, V (m^3), tr(E), lambda where it acts by the patch

vec3 displacement_in(uint node, uint link) {
    vec3 d = fetch(displacement, node).xyz;
    return SPANS && link != 0 ? across(links[link], fetch(node_rest, node).xyz, d) : d;
}

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TETRAHEDRA) return;
    uvec4 nodes = fetch(tetrahedra, t);
    vec4 g1 = fetch(rest_gradients, 3 * t), g2 = fetch(rest_gradients, 3 * t + 1),
        g3 = fetch(rest_gradients, 3 * t + 2);
    vec4 material = materials[element_info[t].x];
    float mu = material.x, lambda = material.y;
    uvec4 link = SPANS ? fetch(tetrahedron_links, t) : uvec4(0);
    vec3 d0 = fetch(displacement, nodes.x).xyz;
    vec3 d1 = displacement_in(nodes.y, link.y) - d0;
    vec3 d2 = displacement_in(nodes.z, link.z) - d0;
    vec3 d3 = displacement_in(nodes.w, link.w) - d0;
    mat3 g = outerProduct(d1, g1.xyz) + outerProduct(d2, g2.xyz) + outerProduct(d3, g3.xyz);
    bool lost;
    mat3 e = strain(polar(mat3(1.0) + g, fetch(rotations, t), lost), g);
    mat3 even = 0.5 * (e + transpose(e));
    float tr = trace(e), shared_lambda = PATCHES && patch_of[t] != NONE ? lambda : 0.0;
    float density = mu * square(even) + 0.5 * (lambda - shared_lambda) * tr * tr;
    if (NEO_HOOKEAN && material.z != LAW_COROTATIONAL) density = neo_hookean_energy(e, mu, lambda);
    density += 0.5 * STIFFENING * (lambda + 2.0 * mu) * square(squeeze(e));
    densities[t] = vec4(density, g1.w * g1.w, tr, shared_lambda);
}
