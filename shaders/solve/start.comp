#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: before the first iteration. Sums over workgroups; the 6x6 blocks of the tool and of dynamic cores, their inverses and
// right-hand sides; the
// factor on the last step's solution that leaves the least residual, w = (y . M^-1 b) / (y . M^-1 y) with y = A x (so a warm
// start never begins worse than none); the loop's indirect arguments. A body at rest (b within rounding) stops at once.
// One workgroup. Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 2) const uint TETRAHEDRA = 0;
layout(constant_id = 3) const bool CONTACT = false;
layout(constant_id = 4) const bool TOOL = false;
layout(constant_id = 5) const uint PARTIALS = 1;        // workgroups of assemble and gather
layout(constant_id = 6) const uint CORES = 0;
layout(constant_id = 7) const bool FRICTION = false;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Partials { vec2 partials[]; };
layout(scalar, binding = 2) readonly buffer Dots { vec2 dots[]; };
layout(scalar, binding = 3) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 4) readonly buffer Contacts { Contact contacts[]; };
layout(binding = 5) uniform samplerBuffer contact_forces;       // of the last solution
layout(scalar, binding = 6) readonly buffer Frames { Frame frames[]; };
layout(binding = 7) uniform samplerBuffer node_rest;
layout(scalar, binding = 8) readonly buffer CoreNodes { uint core_nodes[]; };
layout(binding = 9) uniform samplerBuffer rhs;
layout(binding = 10) uniform samplerBuffer inverse;             // of carried nodes: their diagonal blocks as they are
layout(binding = 11) uniform samplerBuffer image;
layout(scalar, binding = 12) buffer SolveInOut { Solve solve; };
layout(scalar, binding = 13) buffer Cores { Core cores[]; };
layout(scalar, binding = 14) writeonly buffer Args { uint args[]; };

#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/core.glsl"
#include "shared/core_rows.glsl"

const float ROUNDING = 1.0e-7;

// y.M^-1 b over y.M^-1 y; zero at rest, and where the last solution is none or has overflowed.
float warm_factor(vec4 sums) {
    float factor = sums.z / sums.w;
    return sums.x > sums.y && sums.w > 0.0 && !isnan(factor) && !isinf(factor) ? factor : 0.0;
}

// D of a carried node times a vector.
vec3 block_times(uint node, vec3 v) {
    vec3 d = texelFetch(inverse, int(2 * node)).xyz, o = texelFetch(inverse, int(2 * node + 1)).xyz;
    return vec3(d.x * v.x + o.x * v.y + o.y * v.z, o.x * v.x + d.y * v.y + o.z * v.z, o.y * v.x + o.z * v.y + d.z * v.z);
}

// P (P^T D P)^-1 P^T where P maps a spin about `axis` to a twist; false where D has no inertia about it.
bool invert_about(vec3 axis, float block[36], out float inverse[36]) {
    float moment = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) moment += axis[i] * block[6 * (3 + i) + 3 + k] * axis[k];
    }
    for (int k = 0; k < 36; k++) inverse[k] = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) inverse[6 * (3 + i) + 3 + k] = axis[i] * axis[k] / moment;
    }
    return moment > 0.0;
}

// A core's block of the preconditioner, sum P_i^T D_i P_i over the nodes it carries, inverted; its right-hand side, P^T b, the
// gyroscopic impulse, and what the last step left undone; e^2 of the rounding of b.
float assemble_core(uint c) {
    Frame frame = frames[cores[c].frame];
    float block[36];
    for (int k = 0; k < 36; k++) block[k] = 0.0;
    vec3 force = vec3(0.0), torque = vec3(0.0), force_size = vec3(0.0), torque_size = vec3(0.0);
    for (uint k = gl_LocalInvocationID.x; k < cores[c].node_count; k += SIZE) {
        uint node = core_nodes[cores[c].node_first + k];
        vec3 arm = arm_of(node, cores[c].frame);
        vec3 f = texelFetch(rhs, int(node)).xyz;
        force += f;
        torque += cross(arm, f);
        force_size += abs(f);
        torque_size += abs(cross(arm, f));
        for (int j = 0; j < 6; j++) {
            vec3 axis = vec3(j % 3 == 0, j % 3 == 1, j % 3 == 2);
            vec3 moved = block_times(node, j < 3 ? axis : cross(axis, arm));
            vec3 turned = cross(arm, moved);
            for (int i = 0; i < 3; i++) {
                block[6 * i + j] += moved[i];
                block[6 * (3 + i) + j] += turned[i];
            }
        }
    }
    for (int k = 0; k < 36; k += 4) {
        vec4 part = workgroup_sum(vec4(block[k], block[k + 1], block[k + 2], block[k + 3]));
        for (int l = 0; l < 4; l++) block[k + l] = part[l];
    }
    force = workgroup_sum(vec4(force, 0.0)).xyz;
    torque = workgroup_sum(vec4(torque, 0.0)).xyz + frame.gyroscopic;
    force_size = workgroup_sum(vec4(force_size, 0.0)).xyz;
    torque_size = workgroup_sum(vec4(torque_size, 0.0)).xyz;
    float e2 = 0.0;
    if (gl_LocalInvocationID.x == 0) {
        float inverse_block[36];
        bool hinged = cores[c].hinge != vec3(0.0);
        if (!(hinged ? invert_about(cores[c].hinge, block, inverse_block) : invert(block, inverse_block)))
            inverse_block[0] = uintBitsToFloat(0x7fc00000u);
        for (int k = 0; k < 36; k++) cores[c].inverse[k] = inverse_block[k];
        float b[6] = followed(c, force, torque);
        for (int k = 0; k < 6; k++) {
            cores[c].b[k] = b[k] + cores[c].leftover[k];
            float e = k < 3 ? force_size[k] : torque_size[k - 3];
            e2 += e * (e * inverse_block[7 * k]);
        }
    }
    return e2;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint contact_count = CONTACT ? counts.contacts : 0;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < PARTIALS; k += SIZE) sums += vec4(partials[k], dots[k]);
    sums = workgroup_sum(sums);

    if (TOOL) {
        // The tool's block and right-hand side, four numbers at a time: rows of the upper triangle, then b.
        float block[28];
        for (int k = 0; k < 28; k++) block[k] = 0.0;
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contacts[c];
            if (contact.tool_sign == 0.0) continue;
            float column[6];
            tool_column(contact, contact.normal, column);
            float g = params.dt * (params.dt * contact.stiffness + contact.damping) * contact.area;
            float f = params.dt * contact.area * contact.stiffness * contact.depth + g * contact.rate;
            int at = 0;
            for (int i = 0; i < 6; i++) {
                for (int k = i; k < 6; k++) block[at++] += g * column[i] * column[k];
            }
            for (int i = 0; i < 6; i++) block[at++] -= f * column[i];
            if (FRICTION) {
                vec3 along[2];
                tangents(contact.normal, along);
                float viscous = params.dt * contact.friction;
                for (int t = 0; t < 2; t++) {
                    tool_column(contact, along[t], column);
                    at = 0;
                    for (int i = 0; i < 6; i++) {
                        for (int k = i; k < 6; k++) block[at++] += viscous * column[i] * column[k];
                    }
                    float drag = viscous * dot(contact.slip, along[t]);
                    for (int i = 0; i < 6; i++) block[at++] -= drag * column[i];
                }
            }
        }
        for (int k = 0; k < 28; k += 4) {
            vec4 part = workgroup_sum(vec4(block[k], block[k + 1], block[k + 2], block[k + 3]));
            for (int l = 0; l < 4; l++) block[k + l] = part[l];
        }
        float forces[6];
        tool_contact_sum(contact_count, forces);
        if (lane == 0) {
            float matrix[36], inverse[36], b[6], base[36], x[6];
            int at = 0;
            for (int i = 0; i < 6; i++) {
                for (int k = i; k < 6; k++) {
                    matrix[6 * i + k] = params.tool_matrix[6 * i + k] + block[at];
                    matrix[6 * k + i] = params.tool_matrix[6 * k + i] + block[at];
                    at += 1;
                }
            }
            for (int k = 0; k < 36; k++) base[k] = params.tool_matrix[k];
            float e2 = 0.0;
            for (int i = 0; i < 6; i++) {
                b[i] = params.tool_rhs[i] + block[at + i] + solve.tool_leftover[i];
                x[i] = solve.tool_x[i];
            }
            // Singular in f32: not a number, so that the step is not accepted and its flag says so.
            if (!invert(matrix, inverse)) inverse[0] = uintBitsToFloat(0x7fc00000u);
            for (int i = 0; i < 6; i++) {
                float e = abs(params.tool_rhs[i]) + abs(block[at + i]);
                e2 += e * (e * inverse[7 * i]);
            }
            float image[6] = times(base, x);
            for (int i = 0; i < 6; i++) image[i] += forces[i];
            float z[6] = times(inverse, b);
            sums.x += inner(b, z);
            sums.y += ROUNDING * ROUNDING * e2;
            sums.z += inner(image, z);
            sums.w += inner(image, times(inverse, image));
            for (int k = 0; k < 36; k++) solve.tool_inverse[k] = inverse[k];
            for (int i = 0; i < 6; i++) {
                solve.tool_b[i] = b[i];
                // For now the image of the last solution; the residual once the factor is known.
                solve.tool_r[i] = image[i];
                solve.tool_p[i] = 0.0;
                solve.tool_s[i] = 0.0;
            }
        }
    }
    for (uint c = 0; c < CORES; c++) {
        float e2 = assemble_core(c);
        float core_y[6] = core_image(c);
        if (lane == 0) {
            float core_b[6] = cores[c].b, core_inverse[36] = cores[c].inverse;
            float z[6] = times(core_inverse, core_b);
            sums.x += inner(core_b, z);
            sums.y += ROUNDING * ROUNDING * e2;
            sums.z += inner(core_y, z);
            sums.w += inner(core_y, times(core_inverse, core_y));
            for (int i = 0; i < 6; i++) {
                cores[c].r[i] = core_y[i];
                cores[c].p[i] = 0.0;
                cores[c].s[i] = 0.0;
            }
        }
    }
    if (lane != 0) return;
    float warm = warm_factor(sums);
    if (TOOL) {
        float inverse[36] = solve.tool_inverse, r[6];
        for (int i = 0; i < 6; i++) r[i] = solve.tool_b[i] - (warm != 0.0 ? warm * solve.tool_r[i] : 0.0);
        solve.tool_u = times(inverse, r);
        solve.tool_r = r;
        for (int i = 0; i < 6; i++) solve.tool_x[i] = warm != 0.0 ? warm * solve.tool_x[i] : 0.0;
    }
    for (uint c = 0; c < CORES; c++) {
        float inverse[36] = cores[c].inverse, r[6];
        for (int i = 0; i < 6; i++) r[i] = cores[c].b[i] - (warm != 0.0 ? warm * cores[c].r[i] : 0.0);
        cores[c].u = times(inverse, r);
        cores[c].r = r;
        for (int i = 0; i < 6; i++) cores[c].x[i] = warm != 0.0 ? warm * cores[c].x[i] : 0.0;
    }
    bool at_rest = !(sums.x > sums.y);
    solve.warm = warm;
    solve.rhs_norm2 = sums.x;
    solve.floor_norm2 = sums.y;
    solve.gamma = 0.0;
    solve.alpha = 0.0;
    solve.beta = 0.0;
    solve.iterations = 0;
    solve.status = at_rest ? STATUS_CONVERGED : STATUS_RUNNING;
    uint on = at_rest ? 0 : 1;
    args[3 * ARGS_LOOP_APPLY] = on * groups_of(TETRAHEDRA + contact_count);
    args[3 * ARGS_LOOP_GATHER] = on * ((NODES + SIZE - 1) / SIZE);
    args[3 * ARGS_LOOP_ONE] = on;
    args[3 * ARGS_LOOP_UPDATE] = on * groups_of(NODES);
    for (uint k = ARGS_LOOP_APPLY; k <= ARGS_WRENCH; k++) {
        args[3 * k + 1] = 1;
        args[3 * k + 2] = 1;
    }
    args[3 * ARGS_APPLY] = groups_of(TETRAHEDRA + contact_count);
    args[3 * ARGS_APPLY + 1] = 1;
    args[3 * ARGS_APPLY + 2] = 1;
    args[3 * ARGS_COMMIT] = 0;
    args[3 * ARGS_WRENCH] = 0;
}
