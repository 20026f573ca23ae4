#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/contact_law.glsl"

// Solve: product of the contacts' part of the operator with a change of velocity p (shared/contact_product.glsl): before
// the iterations the last solution or the trend, after them the solution x. solve/gather sums these products at the nodes
// and on the tool (rigid body that the haptic device leads). Contacts that were released in this solve have no part in
// the operator; b still contains theirs, which the product with the solution cancels. The kernel runs concurrently with
// solve/element_product. It is a kernel of its own because a branch for contacts in solve/element_product would cost
// time for every tetrahedron on devices that run untaken branches with lanes masked. One invocation runs for each
// contact. The f64 reference is oracle::step. A dynamic core is a rigid body inside a soft one, whose motion the solver
// finds.

layout(local_size_x_id = 0) in;
layout(constant_id = 4) const bool TOOL = true;  // whether there is a rigid tool
layout(constant_id = 6) const uint RIGIDS = 0;   // rigid bodies: dynamic cores and, as the last, the tool
layout(constant_id = 7) const bool FRICTION = false;

layout(push_constant) uniform Which {
    bool is_end;                // true: p is the solution x, after the iterations
};

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(vec4, change);            // p
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_ONLY(uvec4, contacts);
READ_ONLY(uvec4, entry_nodes);      // nodes of contacts, four texels for each contact
READ_ONLY(vec4, entry_weights);
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer ContactForces { vec4 contact_forces[]; };  // xyz: product; w: its normal part

#include "shared/contact.glsl"
#include "shared/contact_product.glsl"

void main() {
    uint c = gl_GlobalInvocationID.x;
    float tool[6];
    if (TOOL) tool = iterates[solve.current * RIGIDS + RIGIDS - 1].x;
    if (c >= counts.contacts) return;
    Contact contact = contact_at(c);
    Relative relative = Relative(0.0, vec3(0.0));
    for (uint k = 0; k < contact.quads; k++) ADD_NODES(relative, contact, 4 * c + k, change)
    if (TOOL && contact.tool_sign != 0.0) add_tool(relative, contact, tool);
    vec4 force = product_with(contact, relative);
    if (is_just_released(contact)) {
        contact.stiffness = -contact.stiffness;
        force = is_end ? part_of_rhs(contact) : vec4(0.0);
    }
    contact_forces[c] = force;
}
