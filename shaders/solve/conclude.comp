#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: the verdict. The residual sqrt((b - A x) . M^-1 (b - A x) / b . M^-1 b) is recomputed, not the recurrence's. A
// contact pulls when k delta + (h k + d) delta' at the end < 0: contacts never adhere, so those are dropped and the host
// has the step solved again, MAX_RETRIES times at most (each starts at the last solution and is short); those that pull even
// then count as zero and a flag says so. Solved, a step may be linearised again. One workgroup.
// Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool TOOL = false;
layout(constant_id = 6) const uint RIGIDS = 0;
layout(constant_id = 8) const uint NODES = 0;
layout(constant_id = 9) const uint SKIN_PARTS = 0;      // workgroups of wrench/gap

layout(scalar) readonly buffer Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Dots { vec2 dots[]; };              // of solve/gather, mode 2
layout(scalar) readonly buffer CoarseDots { vec4 coarse_dots[]; };
READ_ONLY(vec4, restricted_image);     // P^T A x
READ_ONLY(vec4, contact_forces);       // of the solution
layout(scalar) readonly buffer Iterations { Iteration iterations[2]; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) buffer Contacts { Contact contacts[]; };
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) coherent buffer Rigids { Rigid rigids[]; };
layout(scalar) writeonly buffer Args { uint args[]; };
layout(scalar) writeonly buffer ReportOut { Report report; };
layout(scalar) writeonly buffer CoreChanges { float core_changes[]; };     // six a core, for the host
layout(scalar) readonly buffer RigidInverses { float rigid_inverses[]; };

const uint MAX_RETRIES = 4;
// Residual above which a broken solve is not accepted, and any other: there it is further off than where it began.
const float WORTHLESS = 0.1;
const float DIVERGED = 1.0;

shared float deepest[SIZE];

#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/settle.glsl"
#include "shared/twist.glsl"
TWIST_OF(restricted_image)
#include "shared/rigid_inverse.glsl"
#include "shared/rigid.glsl"
#include "shared/contact_law.glsl"

// b - A x in a rigid body's image, and what it is told to the host.
void leave_undone(uint index) {
    float y[6] = image_of(index), x[6] = iterates[solve.current * RIGIDS + index].x;
    for (int k = 0; k < 6; k++) {
        rigids[index].image[k] = rigids[index].b[k] - y[k];
        if (TOOL && index == RIGIDS - 1) report.tool_change[k] = x[k];
        else core_changes[6 * index + k] = x[k];
    }
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint contact_count = CONTACT ? counts.contacts : 0;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < BLOCKS; k += SIZE) sums.xw += dots[k] + (COARSE ? vec2(coarse_dots[k].x, 0.0) : vec2(0.0));
    float depth = 0.0;
    // y: contacts that push or are yet undecided, z: that pull; w: the square of what rounding leaves of the residual.
    if (CONTACT) {
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contacts[c];
            if (is_dropped(contact)) continue;
            bool pulls = end_pressure(contact, fetch(contact_forces, c), params.dt) < 0.0;
            sums.y += 1.0;
            depth = max(depth, contact.depth);
            sums.z += pulls ? 1.0 : 0.0;
        }
    }
    deepest[lane] = depth;
    for (uint index = lane; index < RIGIDS; index += SIZE) leave_undone(index);
    settle();
    for (uint index = lane; index < RIGIDS; index += SIZE) {
        sums.x += inner(rigids[index].image, preconditioned_rows(index, true));
    }
    sums = workgroup_sum(sums);
    bool again = solve.status != STATUS_RUNNING && sums.z > 0.0 && solve.retries < MAX_RETRIES;
    if (CONTACT && again) {
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contacts[c];
            if (is_dropped(contact)) continue;
            if (end_pressure(contact, fetch(contact_forces, c), params.dt) < 0.0) {
                drop(contact);
                contacts[c] = contact;
            }
        }
    }
    // All have read what lane 0 changes.
    barrier();
    if (lane != 0) return;
    float norm2 = max(solve.rhs_norm2, 1.0e-38);
    // The magnitude: far below zero something is as wrong as far above. Not max(sums.x, 0), which may take the zero of what is
    // no number.
    float residual = solve.rhs_norm2 <= solve.floor_norm2 ? 0.0 : sqrt(abs(sums.x) / norm2);
    float residual_floor = sqrt(max(solve.floor_norm2, sums.w) / norm2);
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
        // A solution that is not finite is not committed, nor one whose right-hand side or its rounding overflow: then nothing
        // can be said of the residual. Nor one that broke down early; what merely ran out of iterations is nearer than before.
        float all = sums.x + solve.rhs_norm2 + solve.floor_norm2;
        bool finite = !isnan(all) && !isinf(all);
        if (!finite) {
            flags |= FLAG_NON_FINITE;
            residual = 1.0;
        }
        float worthless = solve.status == STATUS_BROKEN ? WORTHLESS : DIVERGED;
        bool failed = !finite || residual > max(worthless, 10.0 * residual_floor);
        if (failed) {
            verdict = VERDICT_FAILED;
            // Nothing was solved, nothing applied.
            for (int k = 0; k < 3; k++) report.force[k] = report.torque[k] = 0.0;
            report.pressing = 0.0;
        }
        if (!failed && solve.linearisations + 1 < params.newton) {
            verdict = VERDICT_RELINEARISE;
            solve.linearisations += 1;
            solve.retries = 0;
        }
        bool done = verdict == VERDICT_DONE;
        for (uint index = 0; index < RIGIDS && done; index++) rigids[index].leftover = rigids[index].image;
        args[3 * ARGS_COMMIT] = done ? groups_of(NODES) : 0;
        args[3 * ARGS_WRENCH] = done ? 1 : 0;
        args[3 * ARGS_GAP] = done && params.is_held != 0 ? SKIN_PARTS : 0;
    }
    report.verdict = verdict;
    report.iterations = iterations[solve.current].count;
    report.residual = residual;
    report.residual_floor = residual_floor;
    report.contacts = uint(sums.y);
    for (uint k = 0; k < SIZE; k++) depth = max(depth, deepest[k]);
    report.max_depth = depth;
    report.turn = uintBitsToFloat(counts.turn);
    report.flags = flags;
}
