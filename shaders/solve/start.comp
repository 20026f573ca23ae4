#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Solve: before the first iteration. Sums over workgroups; the tool's 6x6 block, its inverse and right-hand side; the
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

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Partials { vec2 partials[]; };
layout(scalar, binding = 2) readonly buffer Dots { vec2 dots[]; };
layout(scalar, binding = 3) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 4) readonly buffer Contacts { Contact contacts[]; };
layout(binding = 5) uniform samplerBuffer contact_forces;       // of the last solution
layout(scalar, binding = 6) buffer SolveInOut { Solve solve; };
layout(scalar, binding = 7) writeonly buffer Args { uint args[]; };

#include "shared/sum.glsl"
#include "shared/tool.glsl"

const float ROUNDING = 1.0e-7;

// Inverse of a symmetric positive definite matrix by Cholesky; false where it is not.
bool invert(float a[36], out float inverse[36]) {
    float l[36];
    for (int k = 0; k < 36; k++) {
        l[k] = 0.0;
        inverse[k] = 0.0;
    }
    for (int j = 0; j < 6; j++) {
        for (int i = j; i < 6; i++) {
            float sum = a[6 * i + j];
            for (int k = 0; k < j; k++) sum -= l[6 * i + k] * l[6 * j + k];
            if (i == j) {
                if (!(sum > 0.0)) return false;
                l[7 * j] = sqrt(sum);
            } else {
                l[6 * i + j] = sum / l[7 * j];
            }
        }
    }
    for (int c = 0; c < 6; c++) {
        float y[6];
        for (int i = 0; i < 6; i++) {
            float sum = i == c ? 1.0 : 0.0;
            for (int k = 0; k < i; k++) sum -= l[6 * i + k] * y[k];
            y[i] = sum / l[7 * i];
        }
        for (int i = 5; i >= 0; i--) {
            float sum = y[i];
            for (int k = i + 1; k < 6; k++) sum -= l[6 * k + i] * inverse[6 * k + c];
            inverse[6 * i + c] = sum / l[7 * i];
        }
    }
    return true;
}

// y.M^-1 b over y.M^-1 y; zero at rest, and where the last solution is none or has overflowed.
float warm_factor(vec4 sums) {
    float factor = sums.z / sums.w;
    return sums.x > sums.y && sums.w > 0.0 && !isnan(factor) && !isinf(factor) ? factor : 0.0;
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
            tool_column(contact, column);
            float g = params.dt * (params.dt * contact.stiffness + contact.damping) * contact.area;
            float f = params.dt * contact.area * contact.stiffness * contact.depth + g * contact.rate;
            int at = 0;
            for (int i = 0; i < 6; i++) {
                for (int k = i; k < 6; k++) block[at++] += g * column[i] * column[k];
            }
            for (int i = 0; i < 6; i++) block[at++] -= f * column[i];
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
            float warm = warm_factor(sums);
            float r[6];
            for (int i = 0; i < 6; i++) r[i] = b[i] - (warm != 0.0 ? warm * image[i] : 0.0);
            float u[6] = times(inverse, r);
            for (int k = 0; k < 36; k++) solve.tool_inverse[k] = inverse[k];
            for (int i = 0; i < 6; i++) {
                solve.tool_b[i] = b[i];
                solve.tool_x[i] = warm != 0.0 ? warm * x[i] : 0.0;
                solve.tool_r[i] = r[i];
                solve.tool_u[i] = u[i];
                solve.tool_p[i] = 0.0;
                solve.tool_s[i] = 0.0;
            }
        }
    }
    if (lane != 0) return;
    bool at_rest = !(sums.x > sums.y);
    solve.warm = warm_factor(sums);
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
