#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/contact_law.glsl"

// Solve: in an iteration, the product of the contacts' part of the operator with u, the preconditioned residual
// (shared/contact_product.glsl), as solve/contact_product computes it outside the iterations. The kernel also counts the
// contacts that are under tension at the present x. Where the iterations have converged and there are such contacts
// (solve/update), the next iteration releases them: its u is zero, and in place of a product each of these contacts
// gives minus its impulse at x, which that iteration subtracts from the residual. One invocation runs for each contact.
// The f64 reference is oracle::step. A dynamic core is a rigid body inside a soft one, whose motion the solver finds; the
// tool is the rigid body that the haptic device leads.

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const bool TOOL = true;  // whether there is a rigid tool
layout(constant_id = 6) const uint RIGIDS = 0;   // rigid bodies: dynamic cores and, as the last, the tool
layout(constant_id = 7) const bool FRICTION = false;

layout(push_constant) uniform Which { uint set; };      // which of the two sets of iterates is read

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(vec4, change);            // u
READ_ONLY(vec4, solution);          // x
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_WRITE(uvec4, contacts);
READ_ONLY(uvec4, entry_nodes);      // nodes of contacts, four texels for each contact
READ_ONLY(vec4, entry_weights);
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) readonly buffer Iterations { Iteration iterations[2]; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer ContactForces { vec4 contact_forces[]; };  // xyz: product; w: its normal part

#include "shared/contact.glsl"
#include "shared/contact_product.glsl"

void main() {
    uint c = gl_GlobalInvocationID.x;
    // What all lanes read is read before they part ways: lavapipe then reads it once, not in each lane.
    RigidIterate tool;
    if (TOOL) tool = iterates[set * RIGIDS + RIGIDS - 1];
    bool releases = iterations[set].is_release == 1;
    if (c >= counts.contacts) return;
    Contact contact = contact_at(c);
    Relative of_u = Relative(0.0, vec3(0.0)), of_x = of_u;
    for (uint k = 0; k < contact.quads; k++) {
        ADD_NODES(of_u, contact, 4 * c + k, change)
        ADD_NODES(of_x, contact, 4 * c + k, solution)
    }
    if (TOOL && contact.tool_sign != 0.0) {
        add_tool(of_u, contact, tool.u);
        add_tool(of_x, contact, tool.x);
    }
    vec4 force = is_just_released(contact) ? vec4(0.0) : product_with(contact, of_u);
    if (!is_released(contact)) {
        vec4 at_x = product_with(contact, of_x);
        if (end_pressure(contact, at_x, params.dt) < 0.0) {
            if (releases) {
                force = part_of_rhs(contact) - at_x;
                release(contact);
                store_contact(c, contact)
            } else {
                atomicAdd(solve.pulling[set], 1);
            }
        }
    }
    contact_forces[c] = force;
}
