#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/contact_law.glsl"

// Solve: product of the contacts' part of the operator with a change of velocity p: for each contact (h^2 k + h d) a n
// n.(J p) + h c (I - n n^T) J p, with the contact's Jacobian J, normal n, area a, stiffness k, damping d and friction c
// (shared/contact_law.glsl), over a step of h seconds. solve/gather sums these products at the nodes and on the tool
// (rigid body that the haptic device leads). The kernel runs concurrently with solve/element_product. It is a kernel of
// its own because a branch for contacts in solve/element_product would cost time for every tetrahedron on devices that
// run untaken branches with lanes masked. One invocation runs for each contact. The f64 reference is oracle::step. A
// dynamic core is a rigid body inside a soft one, whose motion the solver finds.

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const bool TOOL = true;  // whether there is a rigid tool
layout(constant_id = 6) const uint RIGIDS = 0;   // rigid bodies: dynamic cores and, as the last, the tool
layout(constant_id = 7) const bool FRICTION = false;

layout(push_constant) uniform Which {
    bool of_solution;           // true: p is the solution x; false: p is u, the preconditioned residual
    uint set;                   // which of the two sets of iterates holds u
};

layout(scalar) readonly buffer Params { StepParams params; };
READ_ONLY(vec4, change);
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) readonly buffer Contacts { Contact contacts[]; };
READ_ONLY(uvec4, entry_nodes);      // nodes of contacts, four texels for each contact
READ_ONLY(vec4, entry_weights);
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer ContactForces { vec4 contact_forces[]; };  // xyz: product; w: its normal part

void main() {
    uint c = gl_GlobalInvocationID.x;
    if (c >= counts.contacts) return;
    Contact contact = contacts[c];
    float speed = 0.0;
    vec3 relative = vec3(0.0);
    for (uint k = 0; k < contact.quads; k++) {
        uvec4 nodes = fetch(entry_nodes, 4 * c + k);
        vec4 weights = fetch(entry_weights, 4 * c + k);
        vec3 v = weights.x * fetch(change, nodes.x).xyz + weights.y * fetch(change, nodes.y).xyz
            + weights.z * fetch(change, nodes.z).xyz + weights.w * fetch(change, nodes.w).xyz;
        speed += dot(contact.normal, v);
        if (FRICTION) relative += v;
    }
    if (TOOL && contact.tool_sign != 0.0) {
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
    float force = normal_operator(contact, params.dt) * speed;
    vec3 both = force * contact.normal;
    if (FRICTION) both += friction_operator(contact, params.dt) * (relative - dot(contact.normal, relative) * contact.normal);
    contact_forces[c] = vec4(both, force);
}
