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
//
// In an iteration p is u, the preconditioned residual, and the kernel also counts the contacts that are under tension at
// the present x. Where the solver has converged and there are such contacts (solve/update), the next iteration releases
// them: its u is zero, and in place of a product each of these contacts gives minus its impulse at x, which that
// iteration subtracts from the residual. The product with the final solution cancels what b contains of them.

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const bool TOOL = true;  // whether there is a rigid tool
layout(constant_id = 6) const uint RIGIDS = 0;   // rigid bodies: dynamic cores and, as the last, the tool
layout(constant_id = 7) const bool FRICTION = false;

layout(push_constant) uniform Which {
    uint product;               // PRODUCT_* of shared/roles.glsl
    uint set;                   // which of the two sets of iterates holds u
};

layout(scalar) readonly buffer Params { StepParams params; };
READ_ONLY(vec4, change);            // p
READ_ONLY(vec4, solution);          // x
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) buffer Contacts { Contact contacts[]; };
READ_ONLY(uvec4, entry_nodes);      // nodes of contacts, four texels for each contact
READ_ONLY(vec4, entry_weights);
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) readonly buffer Iterations { Iteration iterations[2]; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer ContactForces { vec4 contact_forces[]; };  // xyz: product; w: its normal part

#include "shared/roles.glsl"

// Relative velocity of a contact's two points, m/s: along the normal, and all of it, for friction alone.
struct Relative {
    float speed;
    vec3 velocity;
};

void add(inout Relative relative, vec3 normal, vec3 v) {
    relative.speed += dot(normal, v);
    if (FRICTION) relative.velocity += v;
}

void add_tool(inout Relative relative, Contact contact, float twist[6]) {
    vec3 linear = vec3(twist[0], twist[1], twist[2]), angular = vec3(twist[3], twist[4], twist[5]);
    vec3 lever = contact.tool_sign * cross(contact.arm, contact.normal);
    relative.speed += contact.tool_sign * dot(contact.normal, linear) + dot(lever, angular);
    if (FRICTION) relative.velocity += contact.tool_sign * (linear + cross(angular, contact.arm));
}

vec3 tangential(Contact contact, vec3 v) { return v - dot(contact.normal, v) * contact.normal; }

// Product with the change of velocity whose relative velocity is given; w: its normal part.
vec4 product_with(Contact contact, Relative relative) {
    float force = normal_operator(contact, params.dt) * relative.speed;
    vec3 both = force * contact.normal;
    if (FRICTION) both += friction_operator(contact, params.dt) * tangential(contact, relative.velocity);
    return vec4(both, force);
}

// What the right-hand side b contains of the contact, in the form of a product.
vec4 part_of_rhs(Contact contact) {
    float force = -normal_impulse(contact, params.dt);
    vec3 both = force * contact.normal;
    if (FRICTION) both -= friction_operator(contact, params.dt) * contact.slip;
    return vec4(both, force);
}

void main() {
    uint c = gl_GlobalInvocationID.x;
    if (c >= counts.contacts) return;
    Contact contact = contacts[c];
    bool in_loop = product == PRODUCT_LOOP;
    Relative of_change = Relative(0.0, vec3(0.0)), of_solution = of_change;
    for (uint k = 0; k < contact.quads; k++) {
        uvec4 nodes = fetch(entry_nodes, 4 * c + k);
        vec4 weights = fetch(entry_weights, 4 * c + k);
        add(of_change, contact.normal, weights.x * fetch(change, nodes.x).xyz + weights.y * fetch(change, nodes.y).xyz
            + weights.z * fetch(change, nodes.z).xyz + weights.w * fetch(change, nodes.w).xyz);
        if (in_loop) {
            add(of_solution, contact.normal,
                weights.x * fetch(solution, nodes.x).xyz + weights.y * fetch(solution, nodes.y).xyz
                + weights.z * fetch(solution, nodes.z).xyz + weights.w * fetch(solution, nodes.w).xyz);
        }
    }
    if (TOOL && contact.tool_sign != 0.0) {
        uint tool = (in_loop ? set : solve.current) * RIGIDS + RIGIDS - 1;
        float x[6] = iterates[tool].x, p[6] = x;
        if (in_loop) p = iterates[tool].u;
        add_tool(of_change, contact, p);
        add_tool(of_solution, contact, x);
    }
    vec4 force = product_with(contact, of_change);
    if (is_just_released(contact)) {
        contact.stiffness = -contact.stiffness;
        force = product == PRODUCT_END ? part_of_rhs(contact) : vec4(0.0);
    } else if (in_loop && !is_released(contact)) {
        vec4 at_solution = product_with(contact, of_solution);
        if (end_pressure(contact, at_solution, params.dt) < 0.0) {
            if (iterations[set].is_release == 1) {
                force = part_of_rhs(contact) - at_solution;
                release(contact);
                contacts[c].stiffness = contact.stiffness;
            } else {
                atomicAdd(solve.pulling[set], 1);
            }
        }
    }
    contact_forces[c] = force;
}
