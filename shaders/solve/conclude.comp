#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: the verdict. The residual sqrt((b - A x) . M^-1 (b - A x) / b . M^-1 b) is recomputed, not the recurrence's. A
// contact pulls when k delta + (h k + d) delta' at the end < 0: contacts never adhere, so those are dropped and the host
// has the step solved again, MAX_RETRIES times at most (each starts at the last solution and is short); those that pull even
// then count as zero and a flag says so. One workgroup.
// Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 3) const bool CONTACT = false;
layout(constant_id = 4) const bool TOOL = false;
layout(constant_id = 5) const uint PARTIALS = 1;
layout(constant_id = 6) const uint CORES = 0;
layout(constant_id = 7) const bool FRICTION = false;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Dots { vec2 dots[]; };
layout(scalar, binding = 2) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 3) buffer Contacts { Contact contacts[]; };
layout(binding = 4) uniform samplerBuffer contact_forces;       // of the solution
layout(scalar, binding = 5) readonly buffer Frames { Frame frames[]; };
layout(binding = 6) uniform samplerBuffer node_rest;
layout(scalar, binding = 7) readonly buffer CoreNodes { uint core_nodes[]; };
layout(binding = 8) uniform samplerBuffer image;
layout(scalar, binding = 9) buffer SolveInOut { Solve solve; };
layout(scalar, binding = 10) buffer Cores { Core cores[]; };
layout(scalar, binding = 11) writeonly buffer Args { uint args[]; };
layout(scalar, binding = 12) writeonly buffer ReportOut { Report report; };
layout(scalar, binding = 13) writeonly buffer CoreChanges { float core_changes[]; };     // six a core, for the host

const uint MAX_RETRIES = 4;

shared float deepest[SIZE];

#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/core.glsl"
#include "shared/core_rows.glsl"
#include "shared/pressure.glsl"

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint contact_count = CONTACT ? counts.contacts : 0;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < PARTIALS; k += SIZE) sums.x += dots[k].x;
    float depth = 0.0;
    // y: contacts that push or are yet undecided, z: that pull.
    for (uint c = lane; c < contact_count; c += SIZE) {
        Contact contact = contacts[c];
        if (contact.stiffness == 0.0) continue;
        bool pulls = end_pressure(contact, texelFetch(contact_forces, int(c)), params.dt) < 0.0;
        sums.y += 1.0;
        depth = max(depth, contact.depth);
        sums.z += pulls ? 1.0 : 0.0;
    }
    deepest[lane] = depth;
    sums = workgroup_sum(sums);
    bool again = solve.status != STATUS_RUNNING && sums.z > 0.0 && solve.retries < MAX_RETRIES;
    if (again) {
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contacts[c];
            if (contact.stiffness == 0.0) continue;
            if (end_pressure(contact, texelFetch(contact_forces, int(c)), params.dt) < 0.0) {
                contacts[c].stiffness = 0.0;
                contacts[c].damping = 0.0;
                contacts[c].friction = 0.0;
            }
        }
    }
    float rest[6];
    if (TOOL) {
        float forces[6];
        tool_contact_sum(contact_count, forces);
        if (lane == 0) {
            float base[36], inverse[36], x[6];
            for (int k = 0; k < 36; k++) {
                base[k] = params.tool_matrix[k];
                inverse[k] = solve.tool_inverse[k];
            }
            for (int k = 0; k < 6; k++) x[k] = solve.tool_x[k];
            float own[6] = times(base, x);
            for (int k = 0; k < 6; k++) rest[k] = solve.tool_b[k] - own[k] - forces[k];
            sums.x += inner(rest, times(inverse, rest));
            for (int k = 0; k < 6; k++) report.tool_change[k] = x[k];
        }
    }
    for (uint c = 0; c < CORES; c++) {
        float core_y[6] = core_image(c);
        if (lane == 0) {
            float undone[6], inverse[36] = cores[c].inverse;
            for (int k = 0; k < 6; k++) {
                undone[k] = cores[c].b[k] - core_y[k];
                core_changes[6 * c + k] = cores[c].x[k];
            }
            sums.x += inner(undone, times(inverse, undone));
            cores[c].image = undone;
        }
    }
    if (lane != 0) return;
    float norm2 = max(solve.rhs_norm2, 1.0e-38);
    // Not max(sums.x, 0), which may take the zero of what is no number.
    float residual = solve.rhs_norm2 <= solve.floor_norm2 || sums.x < 0.0 ? 0.0 : sqrt(sums.x / norm2);
    float residual_floor = sqrt(solve.floor_norm2 / norm2);
    uint verdict = VERDICT_DONE;
    if (solve.status == STATUS_RUNNING) verdict = VERDICT_CONTINUE;
    else if (again) verdict = VERDICT_RETRY;
    if (again) {
        solve.retries += 1;
        counts.pulling = uint(sums.z);
    }
    uint flags = counts.flags;
    if (verdict == VERDICT_DONE) {
        // Written so that a residual that is not a number raises the flag as well.
        if (!(residual <= max(10.0 * params.tolerance, 10.0 * residual_floor))) flags |= FLAG_NOT_CONVERGED;
        if (sums.z > 0.0) flags |= FLAG_PULLING;
        // A solution that is not finite is not committed: the state stays as it was, and the flag says so.
        // Nor is one whose right-hand side or its rounding overflow: then nothing can be said of the residual.
        float all = sums.x + solve.rhs_norm2 + solve.floor_norm2;
        bool finite = !isnan(all) && !isinf(all);
        if (!finite) {
            flags |= FLAG_NON_FINITE;
            // Nothing was solved, nothing applied.
            residual = 1.0;
            for (int k = 0; k < 3; k++) report.force[k] = report.torque[k] = 0.0;
        }
        if (TOOL && finite) solve.tool_leftover = rest;
        for (uint c = 0; c < CORES && finite; c++) cores[c].leftover = cores[c].image;
        args[3 * ARGS_COMMIT] = finite ? groups_of(NODES) : 0;
        args[3 * ARGS_WRENCH] = finite ? 1 : 0;
    }
    report.verdict = verdict;
    report.iterations = solve.iterations;
    report.residual = residual;
    report.residual_floor = residual_floor;
    report.contacts = uint(sums.y);
    for (uint k = 0; k < SIZE; k++) depth = max(depth, deepest[k]);
    report.max_depth = depth;
    report.flags = flags;
}
