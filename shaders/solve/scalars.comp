#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: the scalars of one iteration of conjugate gradients with a single reduction (Chronopoulos and Gear 1989):
// gamma = r.u, delta = w.u, beta = gamma / gamma', alpha = gamma / (delta - beta gamma / alpha'). The six rows of
// the tool and of each dynamic core are done here whole, so that they add no pass. Converged, or broken down: the loop's arguments become zero, and all later
// iterations cost nothing. One workgroup. Oracle: oracle::step (a direct solve).

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 3) const bool CONTACT = false;
layout(constant_id = 4) const bool TOOL = false;
layout(constant_id = 5) const uint PARTIALS = 1;
layout(constant_id = 6) const uint CORES = 0;
layout(constant_id = 7) const bool FRICTION = false;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Dots { vec2 dots[]; };
layout(scalar, binding = 2) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 3) readonly buffer Contacts { Contact contacts[]; };
layout(binding = 4) uniform samplerBuffer contact_forces;
layout(scalar, binding = 5) readonly buffer Frames { Frame frames[]; };
layout(binding = 6) uniform samplerBuffer node_rest;
layout(scalar, binding = 7) readonly buffer CoreNodes { uint core_nodes[]; };
layout(binding = 8) uniform samplerBuffer image;
layout(scalar, binding = 9) buffer SolveInOut { Solve solve; };
layout(scalar, binding = 10) buffer Cores { Core cores[]; };
layout(scalar, binding = 11) writeonly buffer Args { uint args[]; };

#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/core.glsl"
#include "shared/core_rows.glsl"

void stop(uint status) {
    solve.status = status;
    args[3 * ARGS_LOOP_APPLY] = 0;
    args[3 * ARGS_LOOP_GATHER] = 0;
    args[3 * ARGS_LOOP_ONE] = 0;
    args[3 * ARGS_LOOP_UPDATE] = 0;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < PARTIALS; k += SIZE) sums.xy += dots[k];
    sums = workgroup_sum(sums);
    float tool_image[6];
    float u[6];
    if (TOOL) {
        tool_contact_sum(CONTACT ? counts.contacts : 0, tool_image);
        if (lane == 0) {
            float base[36];
            for (int k = 0; k < 36; k++) base[k] = params.tool_matrix[k];
            float r[6];
            for (int k = 0; k < 6; k++) {
                u[k] = solve.tool_u[k];
                r[k] = solve.tool_r[k];
            }
            float own[6] = times(base, u);
            for (int k = 0; k < 6; k++) tool_image[k] += own[k];
            sums.x += inner(r, u);
            sums.y += inner(tool_image, u);
        }
    }
    for (uint c = 0; c < CORES; c++) {
        float core_w[6] = core_image(c);
        if (lane == 0) {
            float core_r[6] = cores[c].r, core_u[6] = cores[c].u;
            sums.x += inner(core_r, core_u);
            sums.y += inner(core_w, core_u);
            cores[c].image = core_w;
        }
    }
    if (lane != 0) return;
    float gamma = sums.x, delta = sums.y;
    uint iteration = solve.iterations;
    float enough = max(params.tolerance * params.tolerance * solve.rhs_norm2, solve.floor_norm2);
    if (gamma <= enough) {
        stop(STATUS_CONVERGED);
        return;
    }
    float beta = iteration == 0 ? 0.0 : gamma / solve.gamma;
    float curvature = iteration == 0 ? delta : delta - beta * gamma / solve.alpha;
    if (iteration >= params.max_iterations || !(curvature > 0.0) || isinf(curvature) || isnan(gamma)) {
        stop(STATUS_STOPPED);
        return;
    }
    float alpha = gamma / curvature;
    solve.gamma = gamma;
    solve.beta = beta;
    solve.alpha = alpha;
    solve.iterations = iteration + 1;
    if (TOOL) {
        float r[6];
        for (int k = 0; k < 6; k++) {
            float p = u[k] + beta * solve.tool_p[k];
            float s = tool_image[k] + beta * solve.tool_s[k];
            solve.tool_p[k] = p;
            solve.tool_s[k] = s;
            solve.tool_x[k] += alpha * p;
            r[k] = solve.tool_r[k] - alpha * s;
            solve.tool_r[k] = r[k];
        }
        float inverse[36];
        for (int k = 0; k < 36; k++) inverse[k] = solve.tool_inverse[k];
        u = times(inverse, r);
        for (int k = 0; k < 6; k++) solve.tool_u[k] = u[k];
    }
    for (uint c = 0; c < CORES; c++) {
        float r[6];
        for (int k = 0; k < 6; k++) {
            float p = cores[c].u[k] + beta * cores[c].p[k];
            float s = cores[c].image[k] + beta * cores[c].s[k];
            cores[c].p[k] = p;
            cores[c].s[k] = s;
            cores[c].x[k] += alpha * p;
            r[k] = cores[c].r[k] - alpha * s;
            cores[c].r[k] = r[k];
        }
        float inverse[36] = cores[c].inverse;
        cores[c].u = times(inverse, r);
    }
}
