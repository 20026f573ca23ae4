#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"

// Solve: product of the elements' part of the operator with a change of velocity p. A tetrahedron writes for each of
// its nodes i the force (2 mu sym(W) + lambda tr(W) I + S) g'_i, with W = sum p_i g'_i^T and the stress S of its
// geometric stiffness (shared/geometric.glsl); solve/gather sums these forces at the nodes. elastic/element_forces
// computes the gradients g', the moduli mu and lambda, and the geometric stiffness, scaled by volume and step. One
// invocation runs for each tetrahedron. The f64 references are oracle::elastic::Elements::apply_stiffness and
// oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;

READ_ONLY(uvec4, tetrahedra);
READ_ONLY(vec4, gradients);  // GRADIENT_TEXELS per tetrahedron; w of the first: mu, of the second: lambda
READ_ONLY(vec4, change);
layout(scalar) writeonly buffer ElementForces { vec4 element_forces[]; };      // four per tetrahedron

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TETRAHEDRA) return;
    uvec4 nodes = fetch(tetrahedra, t);
    uint first = GRADIENT_TEXELS * t;
    vec4 g1 = fetch(gradients, first), g2 = fetch(gradients, first + 1);
    vec3 g3 = fetch(gradients, first + 2).xyz;
    vec3 p0 = fetch(change, nodes.x).xyz;
    mat3 w = outerProduct(fetch(change, nodes.y).xyz - p0, g1.xyz)
        + outerProduct(fetch(change, nodes.z).xyz - p0, g2.xyz)
        + outerProduct(fetch(change, nodes.w).xyz - p0, g3);
    float pressure = g2.w * (w[0][0] + w[1][1] + w[2][2]);
    mat3 s = g1.w * (w + transpose(w)) + mat3(pressure, 0, 0, 0, pressure, 0, 0, 0, pressure);
    s += geometric_stress(w, fetch(gradients, first + 3).xyz, fetch(gradients, first + 4).xyz);
    vec3 f1 = s * g1.xyz, f2 = s * g2.xyz, f3 = s * g3;
    element_forces[4 * t] = vec4(-f1 - f2 - f3, 0.0);
    element_forces[4 * t + 1] = vec4(f1, 0.0);
    element_forces[4 * t + 2] = vec4(f2, 0.0);
    element_forces[4 * t + 3] = vec4(f3, 0.0);
}
