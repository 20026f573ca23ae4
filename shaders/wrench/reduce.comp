#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"

// Wrench: computes the net contact force on each tool (rigid body that a haptic device leads), and the net torque about
// the tool's centre. The force of a contact consists of the normal force a max(0, k delta + d delta') and friction, both
// at the end of the step, as the solver applied them; friction is reported by itself as well. For a haptic loop the kernel
// also computes the contact stiffness and damping that a tool feels, sum a k J^T n n^T J and
// sum J^T (a d n n^T + c (I - n n^T)) J over contacts, with J a contact's Jacobian with respect to the tool's twist; the
// compliance of the bodies is left out. Symbols of a contact are as in shared/contact_law.glsl: area a (m^2),
// stiffness k (N/m^3), damping d (N s/m^3), depth delta (m), its rate delta' (m/s), and friction coefficient c (N s/m:
// friction is -c times the sliding velocity); n is the unit normal. Without a haptic loop the stiffness and damping are
// zero. One workgroup runs for each tool. The f64 reference implementation is oracle::wrench.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 7) const bool FRICTION = false;
layout(constant_id = 8) const uint TOOLS = 1;   // number of tools; where there are several, each is a held core

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_ONLY(uvec4, contacts);
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
READ_ONLY(vec4, contact_forces);      // output of solve/contact_product for the solution
layout(scalar) writeonly buffer ReportOut { Report report; };

#include "shared/contact.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/contact_law.glsl"

// Turns `contact` into a contact of one of several tools: gives it this tool's sign and arm. Returns false if the tool
// has no part in it.
bool turn_to(uint tool, inout Contact contact) {
    Pair pair = pairs[contact.side / 2];
    if (pair.tools[0] != tool && pair.tools[1] != tool) return false;
    contact.tool_sign = pair.tools[0] == tool ? 1.0 : -1.0;
    contact.arm += params.tool_centre - params.held[tool].centre;
    // Where two tools touch, the arm leads to a point of the first one.
    if (pair.tools[0] != tool && pair.tools[0] != NONE) contact.arm -= contact.depth * contact.normal;
    return true;
}

void main() {
    uint lane = gl_LocalInvocationID.x, tool = TOOLS > 1 ? gl_WorkGroupID.x : 0;
    bool wants_stiffness = params.wants_stiffness != 0;
    // `sums` holds the force, the torque, the upper triangles of stiffness and damping, the sum of the normal forces'
    // magnitudes, and the friction.
    float sums[52];
    for (int k = 0; k < 52; k++) sums[k] = 0.0;
    for (uint c = lane; c < counts.contacts; c += SIZE) {
        Contact contact = contact_at(c);
        if (is_released(contact) || contact.tool_sign == 0.0) continue;
        if (TOOLS > 1 && !turn_to(tool, contact)) continue;
        vec4 change = fetch(contact_forces, c);
        float force = contact.area * end_pressure(contact, change, params.dt);
        if (force <= 0.0) continue;
        float column[6];
        tool_column(contact, contact.normal, column);
        for (int k = 0; k < 6; k++) sums[k] -= force * column[k];
        sums[48] += force;
        int at = 6;
        for (int i = 0; i < (wants_stiffness ? 6 : 0); i++) {
            for (int k = i; k < 6; k++) {
                sums[at] += normal_stiffness(contact) * column[i] * column[k];
                sums[at + 21] += normal_damping(contact) * column[i] * column[k];
                at += 1;
            }
        }
        if (!FRICTION) continue;
        vec3 drag = end_friction(contact, change, params.dt), along[2];
        tangents(contact.normal, along);
        for (int t = 0; t < 2; t++) {
            tool_column(contact, along[t], column);
            for (int k = 0; k < 6; k++) sums[k] -= dot(drag, along[t]) * column[k];
            for (int k = 0; k < 3; k++) sums[49 + k] -= dot(drag, along[t]) * column[k];
            at = 27;
            for (int i = 0; i < (wants_stiffness ? 6 : 0); i++) {
                for (int k = i; k < 6; k++) sums[at++] += contact.friction * column[i] * column[k];
            }
        }
    }
    for (int k = 0; k < 52; k += 4) {
        if (!wants_stiffness && k >= 8 && k < 48) continue;
        vec4 part = workgroup_sum(vec4(sums[k], sums[k + 1], sums[k + 2], sums[k + 3]));
        for (int l = 0; l < 4; l++) sums[k + l] = part[l];
    }
    if (lane != 0) return;
    for (int k = 0; k < 3; k++) {
        report.tools[tool].force[k] = sums[k];
        report.tools[tool].torque[k] = sums[3 + k];
        report.tools[tool].friction[k] = sums[49 + k];
    }
    report.tools[tool].pressing = sums[48];
    for (int k = 0; k < 21; k++) {
        report.tools[tool].stiffness[k] = sums[6 + k];
        report.tools[tool].damping[k] = sums[27 + k];
    }
}
