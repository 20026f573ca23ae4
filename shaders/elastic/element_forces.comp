#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"

// Elastic stage of a step: rotation, stress and stiffness of each tetrahedron, computed once in each Newton iteration.
// With rest gradients g_i (1/m) and displacements d_i of a tetrahedron's nodes, and its rest volume V, the deformation
// gradient is F = I + G, G = sum d_i g_i^T. The rotation R is the polar part of F, found by shared/polar.glsl
// from the last rotation, and the strain is E = R^T G + (R^T - I).
//
// A frame is a rigid coordinate frame, a link the relative placement of two frames. The kernel writes R, and the scaled
// gradients of the solver's operator in world axes, g' = sqrt(V) R_frame R fold g, with the operator's moduli mu and
// lambda; R_frame is the rotation of the tetrahedron's frame, and `fold` a matrix of the material law
// (shared/material_law.glsl). After these it writes the geometric stiffness (shared/geometric.glsl).
//
// It also writes the tetrahedron's part of the right-hand side over a step h: h (f + h df/dt) - h beta K v, with the
// forces f_i = -V P g_i, the stress P of the material law, the rate df/dt at which f changes with the velocity v
// (`stress_rate`), the operator's stiffness K without the geometric part, and stiffness-proportional damping beta. The
// corotational law has P = R (2 mu sym(E) + lambda tr(E) I). A tetrahedron with nodes in several frames is evaluated in
// its first node's frame. A tetrahedron that is inside out, or whose rotation is not found, raises a flag.
//
// In later Newton iterations the kernel reads the trial displacements of elastic/trial, which contain already the trial
// change of velocity x (the last iteration's solution), and writes h f + h^2 K x - h beta K v, where the first K has the
// geometric part. An F-bar patch is a group of tetrahedra that share one volumetric strain.
//
// One invocation runs for each tetrahedron that can deform, or shares a patch with one that can. The others lie within
// a rigid core: they keep the rotation and the gradients that they had at first, none and zero, and no kernel needs
// their forces. The f64 reference is oracle::elastic::Elements::impulses.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint ELEMENTS = 0;        // length of `deforming`
layout(constant_id = 2) const bool SPANS = false;       // whether a tetrahedron may have nodes in several frames
layout(constant_id = 3) const bool PATCHES = false;     // whether lambda may act through F-bar patches
layout(constant_id = 4) const uint LAWS = 1;            // a bit for each material law in use
layout(constant_id = 5) const bool NEWTON = false;       // whether this is a later Newton iteration

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, frames);
READ_ONLY(uvec4, materials);
READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, rest_gradients);  // three per tetrahedron: g of nodes 2 to 4 (1/m); w of the first: sqrt(V)
READ_ONLY(uvec4, deforming);      // of each tetrahedron that this kernel works on: index, material, frame
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, velocity);
READ_ONLY(uvec4, tetrahedron_links);   // links from the first node's frame to each node's frame; 0: the same frame
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, links);
layout(scalar) readonly buffer PatchOf { uint patch_of[]; };        // patch of each tetrahedron, or NONE
READ_ONLY(vec4, trial_change);                                      // trial change of velocity x, m/s
READ_WRITE(vec4, rotations);                                        // R as quaternions x y z w
layout(scalar) writeonly buffer Gradients { vec4 gradients[]; };    // shared/geometric.glsl; w: see main
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) writeonly buffer ElementForces { vec4 element_forces[]; };  // four per tetrahedron, N s

#include "shared/frame.glsl"
#include "shared/strain.glsl"
#include "shared/material.glsl"
#include "shared/material_law.glsl"
#include "shared/link.glsl"
#include "shared/element.glsl"

void main() {
    if (gl_GlobalInvocationID.x >= ELEMENTS) return;
    uvec4 element = fetch(deforming, gl_GlobalInvocationID.x);
    uint t = element.x, frame = element.z;
    ElasticMaterial material = material_at(element.y);
    uvec4 nodes = fetch(tetrahedra, t);
    vec4 g1 = fetch(rest_gradients, 3 * t), g2 = fetch(rest_gradients, 3 * t + 1),
        g3 = fetch(rest_gradients, 3 * t + 2);
    float root = g1.w;
    uvec4 link = SPANS ? fetch(tetrahedron_links, t) : uvec4(0);
    mat3 g = displacement_gradient(nodes, link, g1.xyz, g2.xyz, g3.xyz);
    bool lost;
    vec4 q = polar(mat3(1.0) + g, fetch(rotations, t), lost);
    if (lost || determinant(mat3(1.0) + g) <= 0.0) atomicOr(counts.flags, FLAG_INVERTED);
    // The next polar decomposition must start from a rotation, even if the displacements have overflowed.
    store(rotations, t, dot(q, q) < 2.0 ? q : vec4(0.0, 0.0, 0.0, 1.0));

    mat3 e = strain(q, g);
    float own_lambda = PATCHES && patch_of[t] != NONE ? 0.0 : material.lambda;
    mat3 compression = excess_compression(e);
    Evaluation law = evaluate(material, e, compression, own_lambda);
    mat3 p = law.stress;
    vec3 k1 = law.fold * g1.xyz, k2 = law.fold * g2.xyz, k3 = law.fold * g3.xyz;
    vec4 world = compose(frame_at(frame).rotation, q);
    vec3 h1 = root * rotate(world, k1), h2 = root * rotate(world, k2), h3 = root * rotate(world, k3);
    float scale = params.dt * (params.dt + material.damping);
    // The components w hold mu and lambda, each times h^2 + h beta, and tr(E); lambda counts as zero where an F-bar
    // patch applies it.
    uint first = GRADIENT_TEXELS * t;
    gradients[first] = vec4(h1, scale * law.mu);
    gradients[first + 1] = vec4(h2, scale * law.lambda);
    gradients[first + 2] = vec4(h3, e[0][0] + e[1][1] + e[2][2]);
    // The geometric stiffness in world axes. A quarter, since the sum of g' x p is twice an axial vector.
    mat3 rows = law.geometric;
    for (int k = 0; k < 3; k++) rows[k] = rotate(world, rows[k]);
    rows = transpose(rows);
    for (int k = 0; k < 3; k++) rows[k] = 0.25 * params.dt * params.dt * rotate(world, rows[k]);
    vec3 diagonal = vec3(rows[0][0], rows[1][1], rows[2][2]), off = vec3(rows[0][1], rows[0][2], rows[1][2]);
    gradients[first + 3] = vec4(diagonal, 0.0);
    gradients[first + 4] = vec4(off, 0.0);

    float impulse = -params.dt * root * root;
    vec3 v0 = fetch(velocity, nodes.x).xyz;
    vec3 v1 = fetch(velocity, nodes.y).xyz - v0, v2 = fetch(velocity, nodes.z).xyz - v0,
        v3 = fetch(velocity, nodes.w).xyz - v0;
    float viscous = params.dt * material.damping;
    mat3 w = outerProduct(v1, h1) + outerProduct(v2, h2) + outerProduct(v3, h3);
    mat3 damping = linear_stress(w, viscous * law.mu, viscous * law.lambda);
    if (NEWTON) {
        float square = params.dt * params.dt;
        vec3 x0 = fetch(trial_change, nodes.x).xyz;
        mat3 x = outerProduct(fetch(trial_change, nodes.y).xyz - x0, h1)
            + outerProduct(fetch(trial_change, nodes.z).xyz - x0, h2)
            + outerProduct(fetch(trial_change, nodes.w).xyz - x0, h3);
        damping -= linear_stress(x, square * law.mu, square * law.lambda) + geometric_stress(x, diagonal, off);
    } else {
        mat3 rate = outerProduct(v1, g1.xyz) + outerProduct(v2, g2.xyz) + outerProduct(v3, g3.xyz);
        for (int k = 0; k < 3; k++) rate[k] = rotate_back(world, rate[k]);
        p += params.dt * stress_rate(material, e, compression, law, rate);
    }
    vec3 f1 = impulse * rotate(world, p * g1.xyz) - damping * h1;
    vec3 f2 = impulse * rotate(world, p * g2.xyz) - damping * h2;
    vec3 f3 = impulse * rotate(world, p * g3.xyz) - damping * h3;
    element_forces[4 * t] = vec4(-f1 - f2 - f3, 0.0);
    element_forces[4 * t + 1] = vec4(f1, 0.0);
    element_forces[4 * t + 2] = vec4(f2, 0.0);
    element_forces[4 * t + 3] = vec4(f3, 0.0);
}
