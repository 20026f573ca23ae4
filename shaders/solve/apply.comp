#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Solve: what elements and contacts do to a change of velocity p. A tetrahedron gives (2 mu sym(W) + lambda tr(W) I) g'_i
// with W = sum p_i g'_i^T, a contact (h^2 k + h d) a n n.(J p) + h c (I - n n^T) J p. One invocation a tetrahedron, then one a contact; the node
// sums follow in solve/gather. Oracle: oracle::elastic::Elements::apply_stiffness, oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TETRAHEDRA = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 6) const uint RIGIDS = 0;
layout(constant_id = 7) const bool FRICTION = false;

layout(push_constant) uniform Which {
    bool of_solution;           // of the tool: its x, else its u
    uint set;                   // of iterates, that holds u
};

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(binding = 1) uniform usamplerBuffer tetrahedra;
layout(binding = 2) uniform samplerBuffer gradients;
layout(binding = 3) uniform samplerBuffer change;
layout(scalar, binding = 4) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 5) readonly buffer Contacts { Contact contacts[]; };
layout(binding = 6) uniform usamplerBuffer entry_nodes;
layout(binding = 7) uniform samplerBuffer entry_weights;
layout(scalar, binding = 8) readonly buffer SolveIn { Solve solve; };
layout(scalar, binding = 9) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar, binding = 10) writeonly buffer ElementForces { vec4 element_forces[]; };
layout(scalar, binding = 11) writeonly buffer ContactForces { vec4 contact_forces[]; };  // of a contact; w: along n

void apply_contact(uint c) {
    Contact contact = contacts[c];
    float speed = 0.0;
    vec3 relative = vec3(0.0);
    for (uint k = 0; k < contact.quads; k++) {
        uvec4 nodes = texelFetch(entry_nodes, int(4 * c + k));
        vec4 weights = texelFetch(entry_weights, int(4 * c + k));
        vec3 v = weights.x * texelFetch(change, int(nodes.x)).xyz + weights.y * texelFetch(change, int(nodes.y)).xyz
            + weights.z * texelFetch(change, int(nodes.z)).xyz + weights.w * texelFetch(change, int(nodes.w)).xyz;
        speed += dot(contact.normal, v);
        if (FRICTION) relative += v;
    }
    if (contact.tool_sign != 0.0) {
        uint tool = (of_solution ? solve.current : set) * RIGIDS + RIGIDS - 1;
        vec3 linear, angular;
        for (int k = 0; k < 3; k++) {
            linear[k] = of_solution ? iterates[tool].x[k] : iterates[tool].u[k];
            angular[k] = of_solution ? iterates[tool].x[3 + k] : iterates[tool].u[3 + k];
        }
        vec3 lever = contact.tool_sign * cross(contact.arm, contact.normal);
        speed += contact.tool_sign * dot(contact.normal, linear) + dot(lever, angular);
        if (FRICTION) relative += contact.tool_sign * (linear + cross(angular, contact.arm));
    }
    float force = params.dt * (params.dt * contact.stiffness + contact.damping) * contact.area * speed;
    vec3 both = force * contact.normal;
    if (FRICTION) both += params.dt * contact.friction * (relative - dot(contact.normal, relative) * contact.normal);
    contact_forces[c] = vec4(both, force);
}

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TETRAHEDRA) {
        if (CONTACT && t - TETRAHEDRA < counts.contacts) apply_contact(t - TETRAHEDRA);
        return;
    }
    uvec4 nodes = texelFetch(tetrahedra, int(t));
    vec4 g1 = texelFetch(gradients, int(3 * t)), g2 = texelFetch(gradients, int(3 * t + 1));
    vec3 g3 = texelFetch(gradients, int(3 * t + 2)).xyz;
    vec3 p0 = texelFetch(change, int(nodes.x)).xyz;
    mat3 w = outerProduct(texelFetch(change, int(nodes.y)).xyz - p0, g1.xyz)
        + outerProduct(texelFetch(change, int(nodes.z)).xyz - p0, g2.xyz)
        + outerProduct(texelFetch(change, int(nodes.w)).xyz - p0, g3);
    float pressure = g2.w * (w[0][0] + w[1][1] + w[2][2]);
    mat3 s = g1.w * (w + transpose(w)) + mat3(pressure, 0, 0, 0, pressure, 0, 0, 0, pressure);
    vec3 f1 = s * g1.xyz, f2 = s * g2.xyz, f3 = s * g3;
    element_forces[4 * t] = vec4(-f1 - f2 - f3, 0.0);
    element_forces[4 * t + 1] = vec4(f1, 0.0);
    element_forces[4 * t + 2] = vec4(f2, 0.0);
    element_forces[4 * t + 3] = vec4(f3, 0.0);
}
