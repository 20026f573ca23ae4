#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/rounding.glsl"
#include "shared/args.glsl"
#include "shared/contact_law.glsl"
#include "shared/rotation.glsl"

// Solve: prepares the scalars and the rigid bodies for the first conjugate gradient iteration on A x = b, with
// preconditioner M; D is made of the nodes' 3x3 diagonal blocks of A. Rigid bodies are dynamic cores (bodies inside
// soft ones, whose motion the solver finds) and the tool (body that the haptic device leads). The kernel sums the inner
// products of all workgroups; inverts the tool's 6x6 block of A and writes the tool's b; and sets the indirect
// arguments of the iterations' dispatches. It also chooses the warm start: the combination f x + g d of the last solution
// x and the trend d, which is the difference of the last two solutions, whose error e has the least energy e . A e, so
// that a warm start is never worse than none (projection on earlier solutions, Fischer 1998). In a solve after the
// step's first, d is minus the last step's solution. It also sets the limit of the error's energy, at which the
// normal forces are accurate enough. Where b is mere rounding error, as at rest, no iteration is run. There is one
// workgroup. The f64 reference is oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool TOOL = false;        // whether there is a rigid tool, the last rigid body
layout(constant_id = 6) const uint RIGIDS = 0;          // rigid bodies: dynamic cores and the tool
layout(constant_id = 7) const bool FRICTION = false;
layout(constant_id = 9) const uint TETRAHEDRA = 0;
layout(constant_id = 11) const uint FREE_BLOCKS = 0;
layout(constant_id = 12) const uint PATCHES = 0;

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_ONLY(uvec4, contacts);
layout(scalar) readonly buffer Partials { vec2 partials[]; };      // b . D^-1 b, and the part of it due to rounding
READ_ONLY(vec4, projections);           // x . b, x . A x and d . A x, from solve/gather
READ_ONLY(vec4, trend_projections);     // d . b and d . A d, from solve/gather
layout(scalar) readonly buffer CoarseDots { float coarse_dots[]; };  // b's part of b . M^-1 b, from solve/coarse
READ_ONLY(vec4, restricted_product);    // A x, summed over each block of nodes (shared/twist.glsl)
READ_ONLY(vec4, restricted_trend);      // A d, likewise
READ_ONLY(vec4, coarse_rhs);          // coarse correction for b, from solve/coarse
READ_ONLY(vec4, coarse_product);        // coarse correction for A x, from solve/coarse
READ_ONLY(vec4, coarse_trend);          // coarse correction for A d, from solve/coarse
layout(scalar) coherent buffer Rigids { Rigid rigids[]; };
layout(scalar) coherent buffer RigidInverses { float rigid_inverses[]; };
layout(scalar) buffer Iterates { RigidIterate iterates[]; };
// Trend of each rigid body in x, twice, as the two sets of iterates lie in memory; -x in the step's first solve, to which
// solve/conclude adds the step's solution.
layout(scalar) buffer RigidTrends { RigidIterate rigid_trends[]; };
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) writeonly buffer Iterations { Iteration iterations[2]; };
layout(scalar) writeonly buffer Args { uint args[]; };

#include "shared/contact.glsl"
#include "shared/six.glsl"
#include "shared/sum.glsl"
#include "shared/tool.glsl"
#include "shared/twist.glsl"
TWIST_OF(restricted_product)
TWIST_OF(restricted_trend)
TWIST_OF(coarse_rhs)
TWIST_OF(coarse_product)
TWIST_OF(coarse_trend)
#include "shared/settle.glsl"
#include "shared/rigid_inverse.glsl"
#include "shared/rigid.glsl"
#include "shared/start.glsl"

// Bound on the error of the normal forces, relative to these forces, as a multiple of the tolerance of the residual:
// 5 % for presets (tolerance 1e-2), less than the difference of 7 % that a hand just notices.
const float FORCE_SHARE = 5.0;
// Least bound on the error of the normal forces, relative to these forces.
const float LEAST_FORCE_SHARE = 1.0e-3;
// Where normal forces are smaller than this, in N, the error is relative to this force.
const float WEAK_FORCE = 1.0;

const uint CORES = RIGIDS - (TOOL ? 1 : 0);

// Inner products of the warm start's two vectors, the last solution x and the trend d.
struct Projections {
    float xb, db;               // x . b, d . b
    float xx, xd, dd;           // x . A x, x . A d, d . A d
};

// Least share of d . A d that lies in a direction of its own; where d is more nearly a multiple of x, it is left out.
const float LEAST_OWN_SHARE = 1.0e-2;


// Factors f and g of the warm start f x + g d. They are zero where the solutions are zero or have overflowed.
vec2 warm_start_factors(Projections p) {
    float f = p.xb / p.xx;
    if (is_nan(p.xx) || p.xx <= 0.0 || !is_finite(f)) return vec2(0.0);
    float share = p.xd / p.xx, own = p.dd - p.xd * share;
    float g = (p.db - share * p.xb) / own;
    return own > LEAST_OWN_SHARE * p.dd && is_finite(g) ? vec2(f - share * g, g) : vec2(f, 0.0);
}

// Energy of the difference of the warm start from the last step's solution. The error of the warm start is orthogonal to
// this difference, so that the energies of both add up. Zero, a lower bound, where that step was rejected or had another
// length.
float change_by(vec2 factors, Projections p) {
    if (factors == vec2(0.0) || solve.solution_dt != params.dt) return 0.0;
    vec2 k = begins_step(solve) ? vec2(factors.x - 1.0, factors.y) : vec2(factors.x, factors.y + 1.0);
    return k.x * k.x * p.xx + (k.y == 0.0 ? 0.0 : k.y * (2.0 * k.x * p.xd + k.y * p.dd));
}

// Writes for the tool the inverse of its block of A, its right-hand side b, and, as `rounding`, an estimate of
// e . M^-1 e from the diagonal of M^-1 alone, where e sums the magnitudes of the terms of b.
void assemble_tool() {
    // Upper triangle of the tool's block by rows (21 numbers), then its right-hand side (6 numbers), then padding. Each
    // call of workgroup_sum sums four of these numbers.
    float block[28];
    for (int k = 0; k < 28; k++) block[k] = 0.0;
    for (uint c = gl_LocalInvocationID.x; c < (CONTACT ? counts.contacts : 0); c += SIZE) {
        Contact contact = contact_at(c);
        if (contact.tool_sign == 0.0) continue;
        float column[6];
        tool_column(contact, contact.normal, column);
        float g = normal_operator(contact, params.dt), f = normal_impulse(contact, params.dt);
        int at = 0;
        for (int i = 0; i < 6; i++) {
            for (int k = i; k < 6; k++) block[at++] += g * column[i] * column[k];
        }
        for (int i = 0; i < 6; i++) block[at++] -= f * column[i];
        if (FRICTION) {
            vec3 along[2];
            tangents(contact.normal, along);
            float viscous = friction_operator(contact, params.dt);
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
    if (gl_LocalInvocationID.x != 0) return;
    float matrix[36], inverse_block[36], rounding = 0.0;
    int at = 0;
    for (int i = 0; i < 6; i++) {
        for (int k = i; k < 6; k++) {
            matrix[6 * i + k] = params.tool_matrix[6 * i + k] + block[at];
            matrix[6 * k + i] = params.tool_matrix[6 * k + i] + block[at];
            at += 1;
        }
    }
    // Where the block is singular in f32 the inverse becomes NaN, so that the step is rejected and a flag reports it.
    if (!invert(matrix, inverse_block)) inverse_block[0] = uintBitsToFloat(0x7fc00000u);
    for (int i = 0; i < 6; i++) {
        rigids[RIGIDS - 1].b[i] = params.tool_rhs[i] + block[at + i] + rigids[RIGIDS - 1].carried_residual[i];
        float e = abs(params.tool_rhs[i]) + abs(block[at + i]);
        rounding += e * (e * inverse_block[7 * i]);
    }
    for (int k = 0; k < 36; k++) rigid_inverses[rigids[RIGIDS - 1].inverse_first + k] = inverse_block[k];
    rigids[RIGIDS - 1].rounding = rounding;
}

// Returns the value of e . A e (J), with the error e of the solution, above which iterations go on. By the inequality of
// Cauchy and Schwarz the error of the sum of the contacts' normal impulses is at most sqrt(w e . A e), where w is the
// sum of the contacts' normal terms in the operator A, since A contains these terms. This bound must be small compared
// with the normal impulse of the last step, once for the contacts of all tools and once for all others.
float energy_limit() {
    vec4 terms = vec4(0.0);
    for (uint c = gl_LocalInvocationID.x; c < counts.contacts; c += SIZE) {
        Contact contact = contact_at(c);
        float term = normal_operator(contact, params.dt);
        terms += contact.tool_sign == 0.0 ? vec4(0.0, term, 0.0, 0.0) : vec4(term, 0.0, 0.0, 0.0);
    }
    terms = workgroup_sum(terms);
    float limit = UNLIMITED, share = max(FORCE_SHARE * params.tolerance, LEAST_FORCE_SHARE);
    for (int k = 0; k < 2; k++) {
        float impulse = share * params.dt * max(solve.normal_forces[k], WEAK_FORCE);
        if (terms[k] > 0.0) limit = min(limit, impulse * (impulse / terms[k]));
    }
    return limit;
}

// Operator product A d in the rows of a rigid body.
float[6] trend_product_of(uint index) {
    bool is_tool = TOOL && index == RIGIDS - 1;
    uint first = is_tool ? BLOCKS : rigids[index].first_coarse_index, count = is_tool ? 1 : rigids[index].block_count;
    vec4 turn = is_tool ? vec4(0.0, 0.0, 0.0, 1.0) : frames[rigids[index].frame].rotation;
    float y[6] = twist_of_restricted_trend(first, count, turn);
    if (is_tool) {
        float own[6] = times(params.tool_matrix, rigid_trends[index].x);
        for (int k = 0; k < 6; k++) y[k] += own[k];
    }
    return y;
}

// Writes the first iterate of a rigid body but for u, and its residual also to `operator_product`.
void start_rigid(uint index, vec2 factors) {
    RigidIterate now;
    float last[6] = iterates[solve.current * RIGIDS + index].x;
    for (int k = 0; k < 6; k++) {
        // Vectors are skipped where their factors are zero, because they may hold NaN after a failed step.
        if (factors.x == 0.0) last[k] = 0.0;
        now.x[k] = factors.x * last[k];
        now.r[k] = rigids[index].b[k];
        if (factors.x != 0.0) now.r[k] -= factors.x * rigids[index].operator_product[k];
        if (factors.y != 0.0) {
            now.x[k] += factors.y * rigid_trends[index].x[k];
            now.r[k] -= factors.y * rigids[index].trend_product[k];
        }
        now.u[k] = now.p[k] = now.s[k] = 0.0;
        if (begins_step(solve)) rigid_trends[index].x[k] = rigid_trends[RIGIDS + index].x[k] = -last[k];
        rigids[index].operator_product[k] = now.r[k];
    }
    iterates[index] = now;
}

// Writes u = M^-1 r of a rigid body's first iterate.
void precondition_rigid(uint index, vec2 factors) {
    float u[6] = preconditioned_rows(index, true);
    if (COARSE && index < CORES) {
        uint coarse_index = rigids[index].first_coarse_index;
        vec4 turn = frames[rigids[index].frame].rotation;
        float of_rhs[6] = twist_of_coarse_rhs(coarse_index, 1, turn);
        float of_product[6] = twist_of_coarse_product(coarse_index, 1, turn);
        float of_trend[6] = twist_of_coarse_trend(coarse_index, 1, turn);
        for (int k = 0; k < 6; k++) {
            u[k] += of_rhs[k];
            if (factors.x != 0.0) u[k] -= factors.x * of_product[k];
            if (factors.y != 0.0) u[k] -= factors.y * of_trend[k];
        }
    }
    iterates[index].u = u;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    // b . M^-1 b, an estimate of it for a b of mere rounding error, x . b, x . A x; and x . A d, d . b, d . A d.
    vec4 sums = vec4(0.0), more = vec4(0.0);
    for (uint k = lane; k < BLOCKS; k += SIZE) {
        vec4 of_last = fetch(projections, k), of_trend = fetch(trend_projections, k);
        sums += vec4(partials[k], of_last.xy);
        more += vec4(of_last.z, of_trend.xy, 0.0);
        if (COARSE) sums.x += coarse_dots[k];
    }
    if (TOOL) assemble_tool();
    settle();
    for (uint index = lane; index < RIGIDS; index += SIZE) {
        rigids[index].operator_product = product_of(index);
        rigids[index].trend_product = trend_product_of(index);
    }
    settle();
    for (uint index = lane; index < RIGIDS; index += SIZE) {
        float b[6] = rigids[index].b, y[6] = rigids[index].operator_product, w[6] = rigids[index].trend_product;
        float x[6] = iterates[solve.current * RIGIDS + index].x, d[6] = rigid_trends[index].x;
        sums += vec4(inner(b, preconditioned_rows(index, false)), ROUNDING * ROUNDING * rigids[index].rounding,
            inner(x, b), inner(x, y));
        more += vec4(inner(d, y), inner(d, b), inner(d, w), 0.0);
    }
    sums = workgroup_sum(sums);
    more = workgroup_sum(more);
    Projections projected = Projections(sums.z, more.y, sums.w, more.x, more.z);
    float limit = UNLIMITED;
    if (CONTACT) limit = energy_limit();
    // After the last of several Newton iterations their solution is taken as it is: its residual is that of the
    // nonlinear equations.
    bool is_check = params.newton > 1 && solve.newton_iterations == params.newton;
    bool at_rest = is_check || !(sums.x > sums.y);
    vec2 factors = is_check ? vec2(1.0, 0.0) : (at_rest ? vec2(0.0) : warm_start_factors(projected));
    for (uint index = lane; index < RIGIDS; index += SIZE) start_rigid(index, factors);
    settle();
    for (uint index = lane; index < RIGIDS; index += SIZE) precondition_rigid(index, factors);
    barrier();
    if (lane != 0) return;
    if (solve.newton_iterations == 0) solve.first_norm2 = sums.x;
    solve.warm_start = float[2](factors.x, factors.y);
    solve.rhs_norm2 = sums.x;
    solve.floor_norm2 = sums.y;
    solve.current = 0;
    solve.status = at_rest ? STATUS_CONVERGED : STATUS_RUNNING;
    solve.energy_limit = limit;
    solve.stop_norm2 = 0.0;
    solve.pulling[0] = solve.pulling[1] = 0;
    iterations[0] = Iteration(0.0, 0.0, 0, 0, 0, 0, vec4(0.0), change_by(factors, projected));
    iterations[1] = Iteration(0.0, 0.0, 0, 0, 0, 0, vec4(0.0), 0.0);
    uint on = at_rest ? 0 : 1, contact_count = CONTACT ? counts.contacts : 0;
    args[3 * ARGS_LOOP_ELEMENT_PRODUCT] = on * groups_of(TETRAHEDRA);
    args[3 * ARGS_LOOP_CONTACT_PRODUCT] = on * groups_of(contact_count);
    args[3 * ARGS_LOOP_PATCHES] = on * groups_of(PATCHES);
    args[3 * ARGS_LOOP_FREE] = on * FREE_BLOCKS;
    args[3 * ARGS_LOOP_ATTACHED] = on * (BLOCKS - FREE_BLOCKS);
    args[3 * ARGS_LOOP_TOOL] = TOOL ? on : 0;
    for (uint k = ARGS_LOOP_ELEMENT_PRODUCT; k <= ARGS_GAP; k++) {
        args[3 * k + 1] = 1;
        args[3 * k + 2] = 1;
    }
    args[3 * ARGS_COMMIT] = 0;
    args[3 * ARGS_WRENCH] = 0;
    args[3 * ARGS_GAP] = 0;
}
