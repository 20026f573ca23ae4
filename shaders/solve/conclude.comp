#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: decides, after the iterations, whether the solution x of the linear system A x = b is accepted, more
// iterations follow, or the step is rejected. There is one workgroup. The f64 reference is oracle::step.
//
// The relative residual sqrt((b - A x) . M^-1 (b - A x) / b . M^-1 b), with preconditioner M, is recomputed; the value
// that the iterations carry along by recurrence is not used. A contact is under tension if its pressure at the end of
// the step (end_pressure in shared/contact_law.glsl) is negative. Contacts do not adhere, so the iterations release such
// contacts (solve/update), a few times at most. The pressure of contacts that are still under tension at the end counts
// as zero, and a flag reports them. Once the system is solved, a further Newton iteration may follow. After the last of
// several Newton iterations the equations are linearised once more at the solution. The residual of this linear system is
// that of the nonlinear equations, and a flag reports it where it is large. A dynamic core is
// a rigid body inside a soft one, whose motion the solver finds; the tool is the body that the haptic device leads.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool TOOL = false;         // whether there is a rigid tool, the last rigid body
layout(constant_id = 6) const uint RIGIDS = 0;           // rigid bodies: dynamic cores and the tool
layout(constant_id = 7) const uint TOOLS = 1;            // number of tools, held cores among them
layout(constant_id = 8) const uint NODES = 0;
layout(constant_id = 9) const uint SKIN_PARTS = 0;      // number of workgroups of wrench/gap

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Dots { vec2 dots[]; };              // inner products from solve/gather after the loop
layout(scalar) readonly buffer CoarseDots { float coarse_dots[]; };   // from solve/coarse after the loop
READ_ONLY(vec4, restricted_product);     // A x, summed over each block of nodes (shared/twist.glsl)
READ_ONLY(vec4, contact_forces);       // output of solve/contact_product for the solution
layout(scalar) readonly buffer Iterations { Iteration iterations[2]; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_WRITE(uvec4, contacts);
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) coherent buffer Rigids { Rigid rigids[]; };
layout(scalar) buffer RigidTrends { RigidIterate rigid_trends[]; };      // as in solve/first_residual
layout(scalar) writeonly buffer Args { uint args[]; };
layout(scalar) writeonly buffer ReportOut { Report report; };
layout(scalar) writeonly buffer CoreChanges { float core_changes[]; };     // change of each core's twist, for the host
layout(scalar) readonly buffer RigidInverses { float rigid_inverses[]; };

// Relative residual above which a solution is rejected if the solve broke down.
const float WORTHLESS = 0.1;
// Relative residual above which every solution is rejected: even x = 0 would then have a smaller residual.
const float DIVERGED = 1.0;
// Residual of the nonlinear equations after the last of several Newton iterations, relative to the step's first
// right-hand side, above which a flag reports them as unsolved.
const float MOST_NONLINEAR = 0.5;

shared float deepest[SIZE];

#include "shared/contact.glsl"
#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/settle.glsl"
#include "shared/twist.glsl"
TWIST_OF(restricted_product)
#include "shared/rigid_inverse.glsl"
#include "shared/rigid.glsl"
#include "shared/contact_law.glsl"
#include "shared/error_energy.glsl"

// Writes a rigid body's residual b - A x to its `operator_product`, and the change of its twist for the host.
void leave_undone(uint index) {
    float y[6] = product_of(index), x[6] = iterates[solve.current * RIGIDS + index].x;
    for (int k = 0; k < 6; k++) {
        rigids[index].operator_product[k] = rigids[index].b[k] - y[k];
        if (TOOL && index == RIGIDS - 1) report.tool_change[k] = x[k];
        else core_changes[6 * index + k] = x[k];
    }
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint contact_count = CONTACT ? counts.contacts : 0;
    vec4 sums = vec4(0.0);
    for (uint k = lane; k < BLOCKS; k += SIZE) sums.xw += dots[k] + (COARSE ? vec2(coarse_dots[k], 0.0) : vec2(0.0));
    float depth = 0.0;
    vec4 forces = vec4(0.0);      // sums of normal forces: x: of the contacts of all tools; y: of all others, N
    // Components of `sums`: x: (b - A x) . M^-1 (b - A x); y: number of contacts that are not released; z: number of
    // contacts under tension; w: estimate of the first component if the solution had rounding errors alone.
    if (CONTACT) {
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contact_at(c);
            if (is_released(contact)) continue;
            float pressure = end_pressure(contact, fetch(contact_forces, c), params.dt);
            bool is_under_tension = pressure < 0.0;
            float force = max(0.0, pressure) * contact.area;
            forces += contact.tool_sign == 0.0 ? vec4(0.0, force, 0.0, 0.0) : vec4(force, 0.0, 0.0, 0.0);
            sums.y += 1.0;
            depth = max(depth, contact.depth);
            sums.z += is_under_tension ? 1.0 : 0.0;
        }
    }
    deepest[lane] = depth;
    for (uint index = lane; index < RIGIDS; index += SIZE) leave_undone(index);
    settle();
    for (uint index = lane; index < RIGIDS; index += SIZE) {
        sums.x += inner(rigids[index].operator_product, preconditioned_rows(index, true));
    }
    sums = workgroup_sum(sums);
    if (CONTACT) forces = workgroup_sum(forces);
    bool is_check = params.newton > 1 && solve.newton_iterations == params.newton;
    if (CONTACT && solve.status != STATUS_RUNNING) {
        for (uint c = lane; c < contact_count; c += SIZE) {
            Contact contact = contact_at(c);
            if (!is_just_released(contact)) continue;
            clear_released(contact);
            store_contact(c, contact)
        }
    }
    // All lanes have now read what lane 0 changes below.
    barrier();
    if (lane != 0) return;
    float norm2 = max(solve.rhs_norm2, LEAST_NORMAL);
    // The magnitude of sums.x is used: a value far below zero is as wrong as one far above zero, and max(sums.x, 0) may
    // hide NaN.
    float residual = solve.rhs_norm2 <= solve.floor_norm2 ? 0.0 : sqrt(abs(sums.x) / norm2);
    float residual_floor = sqrt(max(solve.floor_norm2, sums.w) / norm2);
    uint verdict = VERDICT_DONE;
    if (solve.status == STATUS_RUNNING) verdict = VERDICT_CONTINUE;
    uint flags = counts.flags;
    if (verdict == VERDICT_DONE) {
        // These conditions are written so that NaN raises the flags as well.
        if (is_check) {
            float of_first = solve.first_norm2 > 0.0 ? solve.rhs_norm2 / solve.first_norm2 : 0.0;
            report.nonlinear_residual = residual * sqrt(of_first);
            if (!(residual * sqrt(of_first) <= max(MOST_NONLINEAR, 10.0 * residual_floor * sqrt(of_first)))) {
                flags |= FLAG_NEWTON_NOT_CONVERGED;
            }
            flags |= solve.flags;
        } else {
            float aim = max(params.tolerance, sqrt(solve.stop_norm2 / norm2));
            if (!(residual <= max(10.0 * aim, 10.0 * residual_floor))) flags |= FLAG_NOT_CONVERGED;
            // The solve stopped before the normal forces were accurate; ten times the error is a hundred times the energy.
            bool is_accurate = error_energy(iterations[solve.current]) <= 100.0 * solve.energy_limit;
            if (CONTACT && solve.status != STATUS_CONVERGED && !is_accurate) flags |= FLAG_NOT_CONVERGED;
            // The loop counted the contacts under tension at the same x; their rounding alone must not raise the flag.
            // At rest, without a loop, no velocity parts the bodies, so that pressure is stiffness times depth.
            if (sums.z > 0.0 && solve.pulling[solve.current] > 0) flags |= FLAG_TENSION;
        }
        // A solution is rejected if one of the three numbers that `all` adds is not finite, since the residual then
        // means nothing, or if the residual is above a limit. The limit is low after a breakdown. A solve that merely
        // ran out of iterations is accepted up to the limit DIVERGED: its solution is better than none.
        float all = sums.x + solve.rhs_norm2 + solve.floor_norm2;
        bool finite = is_finite(all);
        if (!finite) {
            flags |= FLAG_NON_FINITE;
            residual = 1.0;
        }
        float worthless = solve.status == STATUS_BROKEN ? WORTHLESS : DIVERGED;
        bool failed = !finite || !is_check && residual > max(worthless, 10.0 * residual_floor);
        if (failed) {
            verdict = VERDICT_FAILED;
            solve.solution_dt = 0.0;
            // A failed step applies no force to the tools.
            for (uint t = 0; t < TOOLS; t++) {
                report.tools[t].pressing = 0.0;
                for (int k = 0; k < 3; k++) {
                    report.tools[t].force[k] = report.tools[t].torque[k] = report.tools[t].friction[k] = 0.0;
                }
            }
        }
        if (!failed && params.newton > 1 && !is_check) {
            verdict = VERDICT_NEWTON;
            solve.newton_iterations += 1;
            solve.flags = flags;
            for (uint index = 0; index < RIGIDS; index++) rigids[index].linear_residual = rigids[index].operator_product;
        }
        bool done = verdict == VERDICT_DONE;
        if (done) solve.solution_dt = params.dt;
        if (CONTACT && done) {
            for (int k = 0; k < 2; k++) solve.normal_forces[k] = forces[k];
        }
        for (uint index = 0; index < RIGIDS && done; index++) {
            for (int k = 0; k < 6; k++) {
                float trend = rigid_trends[index].x[k] + iterates[solve.current * RIGIDS + index].x[k];
                rigid_trends[index].x[k] = rigid_trends[RIGIDS + index].x[k] = trend;
            }
            if (is_check) rigids[index].carried_residual = rigids[index].linear_residual;
            else rigids[index].carried_residual = rigids[index].operator_product;
        }
        args[3 * ARGS_COMMIT] = done ? groups_of(NODES) : 0;
        args[3 * ARGS_WRENCH] = done ? TOOLS : 0;
        args[3 * ARGS_GAP] = done && params.wants_stiffness != 0 ? SKIN_PARTS : 0;
    }
    report.verdict = verdict;
    report.iterations = iterations[solve.current].count;
    report.releases = iterations[solve.current].releases;
    // A check leaves the residual of the last solve in the report.
    if (!is_check) {
        report.residual = residual;
        report.residual_floor = residual_floor;
    }
    report.contacts = uint(sums.y);
    for (uint k = 0; k < SIZE; k++) depth = max(depth, deepest[k]);
    report.max_depth = depth;
    report.turn = uintBitsToFloat(counts.turn);
    report.flags = flags;
}
