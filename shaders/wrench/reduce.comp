#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"

// Wrench: computes the net contact force on the tool (rigid body that the haptic device leads), and the net torque
// about its centre. The force of a contact consists of the normal force a max(0, k delta + d delta') and friction, both
// at the end of the step, as the solver applied them; friction is reported by itself as well. For a haptic loop the
// kernel also computes the contact stiffness and damping that the tool feels, sum a k J^T n n^T J and
// sum J^T (a d n n^T + c (I - n n^T)) J over contacts, with J a contact's Jacobian with respect to the tool's twist; the
// compliance of the bodies is left out. Symbols of a contact are as in shared/contact_law.glsl: area a (m^2), stiffness
// k (N/m^3), damping d (N s/m^3), depth delta (m), its rate delta' (m/s), and friction coefficient c (N s/m: friction is
// -c times the sliding velocity); n is the unit normal. Without a haptic loop the stiffness and damping are zero. There
// is one workgroup. The f64 reference implementation is oracle::wrench.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 7) const bool FRICTION = false;

layout(scalar) readonly buffer Params { StepParams params; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) readonly buffer Contacts { Contact contacts[]; };
READ_ONLY(vec4, contact_forces);      // output of solve/contact_product for the solution
layout(scalar) writeonly buffer ReportOut { Report report; };

#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/contact_law.glsl"

void main() {
    uint lane = gl_LocalInvocationID.x;
    bool wants_stiffness = params.wants_stiffness != 0;
    // `sums` holds the force, the torque, the upper triangles of stiffness and damping, the sum of the normal forces'
    // magnitudes, and the friction.
    float sums[52];
    for (int k = 0; k < 52; k++) sums[k] = 0.0;
    for (uint c = lane; c < counts.contacts; c += SIZE) {
        Contact contact = contacts[c];
        if (is_released(contact) || contact.tool_sign == 0.0) continue;
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
        report.force[k] = sums[k];
        report.torque[k] = sums[3 + k];
        report.friction[k] = sums[49 + k];
    }
    report.pressing = sums[48];
    for (int k = 0; k < 21; k++) {
        report.stiffness[k] = sums[6 + k];
        report.damping[k] = sums[27 + k];
    }
}
