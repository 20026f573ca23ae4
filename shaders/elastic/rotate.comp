#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"

// Elastic: the rotation R of each tetrahedron (polar part of F = I + G, G = sum d_i g_i^T, by Mueller et al. 2016, "A Robust
// Method to Extract the Rotational Part of Deformations", warm-started: proper, and steady under inversion); gradients
// rotated into the world, g' = sqrt(V) R_frame R g; and what the element gives to the right-hand side,
// h f - (h^2 + h beta) K v, f_i = -V P g_i, with P of the material's law (shared/material_law.glsl) of E = R^T G + (R^T - I);
// corotational P = R (2 mu sym(E) + lambda tr(E) I). A tetrahedron whose nodes ride on several frames is evaluated in the
// first node's. One that is inside out, or whose rotation is not found, raises a flag. Linearised again (elastic/trial), it
// reads trial displacements, and gives h f + h^2 K x - h beta K v for the trial change x, which they hold already.
// One invocation a tetrahedron. Oracle: oracle::elastic, oracle::newton.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;
layout(constant_id = 2) const bool SPANS = false;       // whether a tetrahedron may have nodes in several frames
layout(constant_id = 3) const bool PATCHES = false;     // whether lambda may act by patches (elastic/dilate)
layout(constant_id = 4) const uint LAWS = 1;            // a bit for each law that some material has
layout(constant_id = 5) const bool AGAIN = false;       // linearised where the last solve leads

layout(scalar) readonly buffer Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Materials { ElasticMaterial materials[]; };
READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, rest_gradients);       // three a tetrahedron: g of its last three nodes (1/m); w of the first: sqrt(V)
layout(scalar) readonly buffer ElementInfo { uvec2 element_info[]; };    // material, frame; a tetrahedron
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, velocity);
READ_ONLY(uvec4, tetrahedron_links);   // from the first node's frame to each node's; 0: the same
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer Links { Link links[]; };
layout(scalar) readonly buffer PatchOf { uint patch_of[]; };        // patch of each tetrahedron, or NONE
READ_ONLY(vec4, trial_change);
layout(scalar) buffer Rotations { vec4 rotations[]; };
layout(scalar) writeonly buffer Gradients { vec4 gradients[]; };    // three a tetrahedron; w: (h^2 + h beta) times mu, times lambda (0: by patch), tr(E)
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) writeonly buffer ElementForces { vec4 element_forces[]; };  // four a tetrahedron, N s

#include "shared/strain.glsl"
#include "shared/material_law.glsl"
#include "shared/link.glsl"
#include "shared/element.glsl"
#include "shared/lag.glsl"

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TETRAHEDRA) return;
    uvec4 nodes = fetch(tetrahedra, t);
    vec4 g1 = fetch(rest_gradients, 3 * t), g2 = fetch(rest_gradients, 3 * t + 1),
        g3 = fetch(rest_gradients, 3 * t + 2);
    uint frame = element_info[t].y;
    ElasticMaterial material = materials[element_info[t].x];
    float root = g1.w;
    uvec4 link = SPANS ? fetch(tetrahedron_links, t) : uvec4(0);
    mat3 g = displacement_gradient(nodes, link, g1.xyz, g2.xyz, g3.xyz);
    bool lost;
    vec4 q = polar(mat3(1.0) + g, rotations[t], lost);
    if (lost || determinant(mat3(1.0) + g) <= 0.0) atomicOr(counts.flags, FLAG_INVERTED);
    // The next start must be a rotation, whatever a trial that overflows makes of it.
    rotations[t] = dot(q, q) < 2.0 ? q : vec4(0.0, 0.0, 0.0, 1.0);

    mat3 e = strain(q, g);
    float own_lambda = PATCHES && patch_of[t] != NONE ? 0.0 : material.lambda;
    Evaluation law = evaluate(material, e, squeeze(e), own_lambda);
    mat3 p = law.stress;
    vec3 k1 = law.fold * g1.xyz, k2 = law.fold * g2.xyz, k3 = law.fold * g3.xyz;
    vec4 world = compose(frames[frame].rotation, q);
    vec3 h1 = root * rotate(world, k1), h2 = root * rotate(world, k2), h3 = root * rotate(world, k3);
    float scale = params.dt * (params.dt + material.damping);
    gradients[3 * t] = vec4(h1, scale * law.mu);
    gradients[3 * t + 1] = vec4(h2, scale * law.lambda);
    gradients[3 * t + 2] = vec4(h3, e[0][0] + e[1][1] + e[2][2]);

    float impulse = -params.dt * root * root;
    vec3 v0 = lag(nodes.x, material.damping);
    mat3 w = outerProduct(lag(nodes.y, material.damping) - v0, h1) + outerProduct(lag(nodes.z, material.damping) - v0, h2)
        + outerProduct(lag(nodes.w, material.damping) - v0, h3);
    mat3 damping = linear_stress(w, scale * law.mu, scale * law.lambda);
    vec3 f1 = impulse * rotate(world, p * g1.xyz) - damping * h1;
    vec3 f2 = impulse * rotate(world, p * g2.xyz) - damping * h2;
    vec3 f3 = impulse * rotate(world, p * g3.xyz) - damping * h3;
    element_forces[4 * t] = vec4(-f1 - f2 - f3, 0.0);
    element_forces[4 * t + 1] = vec4(f1, 0.0);
    element_forces[4 * t + 2] = vec4(f2, 0.0);
    element_forces[4 * t + 3] = vec4(f3, 0.0);
}
