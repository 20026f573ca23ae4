#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: before the first iteration. Sums over workgroups; the 6x6 blocks of the tool and of dynamic cores, their inverses
// and right-hand sides; the factor on the last step's solution that leaves the least residual, w = (y . M^-1 b) / (y . M^-1
// y) with y = A x (so a warm start never begins worse than none); the loop's indirect arguments. A body at rest (b within
// rounding) stops at once. One workgroup. Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool TOOL = false;
layout(constant_id = 6) const uint RIGIDS = 0;          // cores, and the tool
layout(constant_id = 7) const bool FRICTION = false;
layout(constant_id = 9) const uint TETRAHEDRA = 0;
layout(constant_id = 11) const uint FREE_BLOCKS = 0;
layout(constant_id = 12) const uint PATCHES = 0;
layout(constant_id = 13) const uint HELD = NONE;        // the core that the device holds

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Frames { Frame frames[]; };
layout(binding = 2) uniform usamplerBuffer block_nodes;
layout(binding = 3) uniform samplerBuffer node_rest;
layout(scalar, binding = 4) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 5) readonly buffer Contacts { Contact contacts[]; };
layout(scalar, binding = 6) readonly buffer Partials { vec2 partials[]; };      // of solve/assemble
layout(scalar, binding = 7) readonly buffer Dots { vec2 dots[]; };              // of solve/gather, mode 0
layout(scalar, binding = 8) readonly buffer CoarseDots { vec4 coarse_dots[]; };
layout(binding = 9) uniform samplerBuffer restricted_rhs;       // P^T b
layout(binding = 10) uniform samplerBuffer restricted_image;    // P^T A x
layout(binding = 11) uniform samplerBuffer coarse_rhs;
layout(binding = 12) uniform samplerBuffer coarse_image;
layout(binding = 13) uniform samplerBuffer rhs;
layout(binding = 14) uniform samplerBuffer inverse;             // of carried nodes: their diagonal blocks as they are
layout(scalar, binding = 15) buffer Rigids { Rigid rigids[]; };
layout(scalar, binding = 16) buffer Iterates { RigidIterate iterates[]; };
layout(scalar, binding = 17) buffer SolveInOut { Solve solve; };
layout(scalar, binding = 18) writeonly buffer Iterations { Iteration iterations[2]; };
layout(scalar, binding = 19) writeonly buffer Args { uint args[]; };

#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/core.glsl"
#include "shared/rigid.glsl"

const uint CORES = RIGIDS - (TOOL ? 1 : 0);

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

// The inverse of a core's block of A, sum P_i^T D_i P_i over the nodes it carries and its coupling if it is held; e^2 of
// the rounding of its b.
float assemble_core(uint c) {
    Frame frame = frames[rigids[c].frame];
    float block[36];
    for (int k = 0; k < 36; k++) block[k] = 0.0;
    vec3 force_size = vec3(0.0), torque_size = vec3(0.0);
    for (uint k = gl_LocalInvocationID.x; k < rigids[c].node_count; k += SIZE) {
        uint node = texelFetch(block_nodes, int(rigids[c].node_first + k)).x;
        vec3 arm = arm_of(node, frame.rotation);
        vec3 f = texelFetch(rhs, int(node)).xyz;
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
    force_size = workgroup_sum(vec4(force_size, 0.0)).xyz;
    torque_size = workgroup_sum(vec4(torque_size, 0.0)).xyz;
    float e2 = 0.0;
    if (gl_LocalInvocationID.x == 0) {
        float inverse_block[36];
        if (HELD != NONE && c == HELD) {
            for (int k = 0; k < 36; k++) block[k] += params.tool_matrix[k];
            force_size += abs(vec3(params.tool_rhs[0], params.tool_rhs[1], params.tool_rhs[2]));
            torque_size += abs(vec3(params.tool_rhs[3], params.tool_rhs[4], params.tool_rhs[5]));
        }
        bool hinged = rigids[c].hinge != vec3(0.0);
        if (!(hinged ? invert_about(rigids[c].hinge, block, inverse_block) : invert(block, inverse_block)))
            inverse_block[0] = uintBitsToFloat(0x7fc00000u);
        rigids[c].inverse = inverse_block;
        rigids[c].b = twist_of(restricted_rhs, rigids[c].slot_first, rigids[c].block_count, frame.rotation);
        for (int k = 0; k < 6; k++) {
            float e = k < 3 ? force_size[k] : torque_size[k - 3];
            e2 += e * (e * inverse_block[7 * k]);
        }
    }
    return e2;
}

// The inverse of the tool's block, its right-hand side; e^2 of the rounding of that.
float assemble_tool() {
    // Four numbers at a time: rows of the upper triangle, then b.
    float block[28];
    for (int k = 0; k < 28; k++) block[k] = 0.0;
    for (uint c = gl_LocalInvocationID.x; c < (CONTACT ? counts.contacts : 0); c += SIZE) {
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
    float e2 = 0.0;
    if (gl_LocalInvocationID.x == 0) {
        float matrix[36], inverse_block[36], b[6];
        int at = 0;
        for (int i = 0; i < 6; i++) {
            for (int k = i; k < 6; k++) {
                matrix[6 * i + k] = params.tool_matrix[6 * i + k] + block[at];
                matrix[6 * k + i] = params.tool_matrix[6 * k + i] + block[at];
                at += 1;
            }
        }
        // Singular in f32: not a number, so that the step is not accepted and its flag says so.
        if (!invert(matrix, inverse_block)) inverse_block[0] = uintBitsToFloat(0x7fc00000u);
        for (int i = 0; i < 6; i++) {
            b[i] = params.tool_rhs[i] + block[at + i] + rigids[RIGIDS - 1].leftover[i];
            float e = abs(params.tool_rhs[i]) + abs(block[at + i]);
            e2 += e * (e * inverse_block[7 * i]);
        }
        rigids[RIGIDS - 1].inverse = inverse_block;
        rigids[RIGIDS - 1].b = b;
    }
    return e2;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < BLOCKS; k += SIZE) {
        sums += vec4(partials[k], dots[k]);
        if (COARSE) sums += vec4(coarse_dots[k].x, 0.0, coarse_dots[k].yz);
    }
    sums = workgroup_sum(sums);
    for (uint index = 0; index < RIGIDS; index++) {
        float e2 = index < CORES ? assemble_core(index) : assemble_tool();
        if (lane == 0) {
            float b[6] = rigids[index].b, y[6] = image_of(index), z[6] = times(rigids[index].inverse, b);
            sums += vec4(inner(b, z), ROUNDING * ROUNDING * e2, inner(y, z), inner(y, times(rigids[index].inverse, y)));
        }
    }
    if (lane != 0) return;
    float warm = warm_factor(sums);
    for (uint index = 0; index < RIGIDS; index++) {
        RigidIterate now;
        float y[6] = image_of(index), last[6] = iterates[solve.current * RIGIDS + index].x;
        for (int k = 0; k < 6; k++) {
            now.x[k] = warm != 0.0 ? warm * last[k] : 0.0;
            now.r[k] = rigids[index].b[k] - (warm != 0.0 ? warm * y[k] : 0.0);
            now.p[k] = 0.0;
            now.s[k] = 0.0;
        }
        now.u = times(rigids[index].inverse, now.r);
        if (COARSE && index < CORES) {
            uint slot = rigids[index].slot_first;
            float of_rhs[6] = twist_of(coarse_rhs, slot, 1, frames[rigids[index].frame].rotation);
            float of_image[6] = twist_of(coarse_image, slot, 1, frames[rigids[index].frame].rotation);
            for (int k = 0; k < 6; k++) now.u[k] += of_rhs[k] - (warm != 0.0 ? warm * of_image[k] : 0.0);
        }
        iterates[index] = now;
    }
    bool at_rest = !(sums.x > sums.y);
    solve.warm = warm;
    solve.rhs_norm2 = sums.x;
    solve.floor_norm2 = sums.y;
    solve.current = 0;
    solve.status = at_rest ? STATUS_CONVERGED : STATUS_RUNNING;
    iterations[0] = Iteration(0.0, 0.0, 0);
    iterations[1] = Iteration(0.0, 0.0, 0);
    uint on = at_rest ? 0 : 1, contact_count = CONTACT ? counts.contacts : 0;
    args[3 * ARGS_LOOP_APPLY] = on * groups_of(TETRAHEDRA);
    args[3 * ARGS_LOOP_PRESS] = on * groups_of(contact_count);
    args[3 * ARGS_LOOP_PATCHES] = on * groups_of(PATCHES);
    args[3 * ARGS_LOOP_FREE] = on * FREE_BLOCKS;
    args[3 * ARGS_LOOP_CARRIED] = on * (BLOCKS - FREE_BLOCKS);
    args[3 * ARGS_LOOP_TOOL] = TOOL ? on : 0;
    for (uint k = ARGS_LOOP_APPLY; k <= ARGS_WRENCH; k++) {
        args[3 * k + 1] = 1;
        args[3 * k + 2] = 1;
    }
    args[3 * ARGS_COMMIT] = 0;
    args[3 * ARGS_WRENCH] = 0;
}
