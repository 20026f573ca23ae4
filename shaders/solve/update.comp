#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Solve: computes one iteration of preconditioned conjugate gradients with a single reduction (Chronopoulos and Gear
// 1989). With operator A, preconditioner M, iterate x, residual r, u = M^-1 r, w = A u, search direction p, s = A p,
// gamma = r.u, delta = w.u, and gamma' and alpha' of the last iteration: beta = gamma / gamma',
// alpha = gamma / (delta - beta gamma / alpha'), p = u + beta p, s = w + beta s, x += alpha p, r -= alpha s,
// u = M^-1 r.
//
// A block is a set of nodes that one workgroup works on; its modes are the basis of the preconditioner's coarse space,
// and P^T restricts to these modes (shared/coarse_vector.glsl). Every workgroup computes the inner products, and sums
// over the modes of its whole body, by itself and in the same order, so none waits for another's result. There are two
// sets of iterates: one is read, the other written. When the loop of iterations ends, the indirect arguments (numbers
// of workgroups) of its dispatches become zero, so that all iterations recorded after this cost next to nothing. One
// workgroup runs for each block of free nodes, for each block of nodes attached to a core (rigid body inside a soft
// one), or for the six rows of the tool (rigid body that the haptic device leads): these are variants, selected by
// ROLE, that run concurrently. A group is the rigid bodies that joints connect. The f64 reference is oracle::step. A
// frame is a rigid coordinate frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool SUPPORTS = false;         // whether some nodes are supported (shared/support.glsl)
layout(constant_id = 5) const uint PARTIALS = 1;        // number of workgroups of solve/gather: blocks and the tool
layout(constant_id = 6) const uint RIGIDS = 0;          // rigid bodies: dynamic cores and, as the last, the tool
layout(constant_id = 8) const uint ROLE = 0;            // FREE_NODES, ATTACHED_NODES or TOOL_ROWS of shared/roles.glsl
layout(constant_id = 9) const uint FIRST = 0;           // first of the blocks that this ROLE works on
layout(constant_id = 11) const bool LEADS = true;       // whether this variant writes the scalars; exactly one does
layout(constant_id = 12) const uint WIDEST = 1;         // number of rigid bodies in the largest group

layout(push_constant) uniform Which { uint set; };      // set of iterates that is read; the other is written

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(vec4, block_turns);                           // rotation of each block, world
READ_ONLY(uvec4, blocks);
READ_ONLY(uvec4, block_nodes);
READ_ONLY(vec4, block_places);  // xyz: middle of a block in its frame, m; w: 1 / the block's size, 1/m
READ_ONLY(vec4, node_rest);
READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(uvec4, coarse_inverse);
READ_ONLY(vec4, coarse_scales);
READ_ONLY(vec4, dots);      // r . u and w . u of each workgroup of solve/gather, two of them in a texel
READ_ONLY(vec4, restricted_product);         // P^T w, three texels per block
READ_ONLY(vec4, restricted_residual);     // P^T r
READ_ONLY(vec4, operator_product);                   // w
READ_ONLY(vec4, inverse);                 // inverse of each node's 3x3 diagonal block of A, two texels
READ_ONLY(vec4, blocks_without_contacts);     // E of shared/preconditioner.glsl, two texels per node
READ_ONLY(vec4, residual);
READ_ONLY(vec4, preconditioned);
READ_ONLY(vec4, direction);
READ_ONLY(vec4, direction_product);
layout(scalar) readonly buffer Rigids { Rigid rigids[]; };
layout(scalar) buffer SolveInOut { Solve solve; };
layout(scalar) buffer Iterations { Iteration iterations[2]; };
layout(scalar) buffer Iterates { RigidIterate iterates[]; };
READ_ONLY(vec4, restricted_direction);    // P^T s
layout(scalar) writeonly buffer NextRestrictedDirection { vec4 next_restricted_direction[]; };
READ_WRITE(vec4, solution);
layout(scalar) writeonly buffer NextResidual { vec4 next_residual[]; };
layout(scalar) writeonly buffer NextPreconditioned { vec4 next_preconditioned[]; };
layout(scalar) writeonly buffer NextDirection { vec4 next_direction[]; };
layout(scalar) writeonly buffer NextDirectionProduct { vec4 next_direction_product[]; };
layout(scalar) writeonly buffer Args { uint args[]; };
layout(scalar) readonly buffer RigidInverses { float rigid_inverses[]; };

const uint SUMS = 3;

shared uint status_read;
shared float rigid_x[6];
shared float rigid_u[6];
shared float group_residuals[6 * WIDEST];

#include "shared/roles.glsl"
#include "shared/sums.glsl"
#include "shared/rigid_inverse.glsl"
#include "shared/blocks.glsl"
#include "shared/coarse_vector.glsl"
#include "shared/symmetric.glsl"

const bool SMOOTHS = CONTACT || SUPPORTS;     // whether P differs from P_0 (shared/preconditioner.glsl)
#include "shared/preconditioner.glsl"
#include "shared/coarse.glsl"
#include "shared/core.glsl"
#include "shared/error_energy.glsl"
#include "shared/twist.glsl"
TWIST_OF(restricted_product)

struct Scalars {
    float alpha, beta;
    bool clears_u;              // whether the next u is zero
};


// Whether the loop goes on; the same in all lanes of a workgroup, so that all of them reach the same barriers. Variants
// that do not lead are dispatched in every recorded iteration, also after the loop has ended. In the iteration that
// ends it the leading variant writes `solve.status` while the others read it; next_scalars returns false in all
// workgroups then, so it does not matter which value a workgroup reads, but its lanes must agree on one. (Vulkan memory
// model: without synchronisation between the write and the reads, each read may return either value.)
bool is_running() {
    if (LEADS) return true;             // dispatched only while the loop runs
    if (ONE_SUBGROUP) return subgroupMax(solve.status) == STATUS_RUNNING;
    if (gl_LocalInvocationID.x == 0) status_read = solve.status;
    barrier();
    return status_read == STATUS_RUNNING;
}

// Ends the loop at r . M^-1 r = `gamma`: clears its indirect arguments. Only the first invocation of the variant that
// LEADS does so.
void stop(uint status, float gamma) {
    if (!LEADS || gl_WorkGroupID.x != 0 || gl_LocalInvocationID.x != 0) return;
    solve.status = status;
    if (status == STATUS_CONVERGED) solve.stop_norm2 = abs(gamma);
    for (uint k = ARGS_LOOP_ELEMENT_PRODUCT; k <= ARGS_LOOP_TOOL; k++) args[3 * k] = 0;
}

// Returns whether the error of the solution is so small that the contacts' normal forces are accurate enough
// (energy_limit in solve/first_residual). The residual does not tell: where a stiff contact holds a light body, a small
// residual may leave a large error.
bool normal_forces_are_accurate(Iteration last, float energy_limit) {
    if (energy_limit >= UNLIMITED) return true;
    return last.fresh >= ERROR_DELAY && error_energy(last) <= energy_limit;
}

// Writes the scalars that the next iteration reads.
void advance(Iteration next) {
    if (!LEADS || gl_WorkGroupID.x != 0 || gl_LocalInvocationID.x != 0) return;
    iterations[1 - set] = next;
    solve.current = 1 - set;
    if (CONTACT) solve.pulling[1 - set] = 0;
}

// Ends the loop and returns false, unless contacts are under tension: these are then released, and the iterations go on
// for the others. That takes two iterations, which change nothing else. This one, with alpha = 0, leaves u = 0; the next
// one, with u = p = 0, has as its operator product the impulses that the released contacts lose
// (solve/contact_iteration), which alpha = 1 subtracts from the residual. Then the search directions start anew.
bool release_or_stop(uint status, float gamma, Iteration last, uint pulling, out Scalars scalars) {
    scalars = Scalars(0.0, 0.0, true);
    if (pulling == 0 || last.releases == MAX_RELEASES) {
        stop(status, gamma);
        return false;
    }
    last.is_release = 1;
    advance(last);
    return true;
}

// Computes alpha and beta of this iteration; returns false if the loop ends here.
bool next_scalars(out Scalars scalars) {
    // What all lanes read is read before any branch: lavapipe then reads it once, not in each lane.
    Iteration last = iterations[set];
    float rhs_norm2 = solve.rhs_norm2, floor_norm2 = solve.floor_norm2;
    float energy_limit = CONTACT ? solve.energy_limit : UNLIMITED;
    uint pulling = CONTACT ? solve.pulling[set] : 0;
    vec4 totals[SUMS] = vec4[SUMS](vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint k = gl_LocalInvocationID.x; k < PARTIALS; k += SIZE) totals[0].xy += half_of(fetch(dots, k / 2), k);
    workgroup_sums(totals, 1);
    float gamma = totals[0].x, delta = totals[0].y;
    if (CONTACT && last.is_release == 1) {
        scalars = Scalars(1.0, 0.0, false);
        advance(Iteration(0.0, 0.0, last.count, 0, last.releases + 1, 0, vec4(0.0), last.change));
        return true;
    }
    float enough = max(params.tolerance * params.tolerance * rhs_norm2, floor_norm2);
    // The magnitude of gamma is compared: a gamma far below zero (M is then not positive definite) is no convergence.
    bool is_small = abs(gamma) <= enough;
    bool is_loose = abs(gamma) <= params.loosest * params.loosest * rhs_norm2;
    is_small = is_small || is_loose && error_energy_left(last) <= STEP_ERROR_SHARE * last.change;
    if (CONTACT && is_small) is_small = abs(gamma) <= floor_norm2 || normal_forces_are_accurate(last, energy_limit);
    if (is_small) return release_or_stop(STATUS_CONVERGED, gamma, last, pulling, scalars);
    scalars.clears_u = false;
    scalars.beta = last.fresh == 0 ? 0.0 : gamma / last.gamma;
    float curvature = last.fresh == 0 ? delta : delta - scalars.beta * gamma / last.alpha;
    // Where the residual grew suddenly, the difference that gives the curvature may be lost to rounding: the search
    // directions then start anew from u.
    if (scalars.beta > 1.0 && curvature <= 0.0 && is_finite(curvature) && delta > 0.0) {
        scalars.beta = 0.0;
        curvature = delta;
    }
    bool broken = gamma < 0.0 || curvature <= 0.0;
    // Where a number is not finite, u or w may hold others, which no factor makes harmless.
    if (!is_finite(gamma) || !is_finite(curvature)) {
        stop(STATUS_BROKEN, gamma);
        return false;
    }
    if (broken) return release_or_stop(STATUS_BROKEN, gamma, last, pulling, scalars);
    if (last.fresh >= params.max_iterations) return release_or_stop(STATUS_STOPPED, gamma, last, pulling, scalars);
    scalars.alpha = gamma / curvature;
    vec4 energies = vec4(scalars.alpha * gamma, last.energies.xyz);
    advance(Iteration(gamma, scalars.alpha, last.count + 1, last.fresh + 1, last.releases, 0, energies,
        last.change + energies.x));
    return true;
}

// Texel k of the body's part of P^T r (restriction to the modes) with the new r: four modes multiplied by their scales;
// zero beyond the body's last texel.
vec4 next_coarse_vector(CoarseBlock block, uint k, Scalars scalars) {
    if (k >= block.texels) return vec4(0.0);
    uint at = block.first + k;
    vec4 s = fetch(restricted_product, at) + scalars.beta * fetch(restricted_direction, at);
    return coarse_scale(at) * (fetch(restricted_residual, at) - scalars.alpha * s);
}

// Coarse correction of a block, A_c^-1 P^T r (shared/coarse.glsl) with the new r, in the block's axes. Also writes the
// block's part of P^T s.
vec4[3] coarse_correction(uint b, Scalars scalars) {
    CoarseBlock block = coarse_block(b);
    vec4 totals[SUMS] = vec4[SUMS](vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint k = gl_LocalInvocationID.x; k < row_texels(block); k += SIZE) {
        vec4 low = next_coarse_vector(block, 2 * k, scalars), high = next_coarse_vector(block, 2 * k + 1, scalars);
        add_products(totals, block, k, low, high);
    }
    if (gl_LocalInvocationID.x < 3) {
        uint at = block.own + gl_LocalInvocationID.x;
        next_restricted_direction[at] =
            fetch(restricted_product, at) + scalars.beta * fetch(restricted_direction, at);
    }
    workgroup_sums(totals, 3);
    for (int row = 0; row < 3; row++) totals[row] *= block.texels > 0 ? coarse_scale(block.own + row) : vec4(0.0);
    return totals;
}

// Updates x, r, p and s of a core or of the tool, and returns its new residual. A single invocation calls this.
void update_rigid(uint index, vec4 turn, Scalars scalars, bool writes, out float residual[6]) {
    bool is_tool = ROLE == TOOL_ROWS;
    float rows[6] = twist_of_restricted_product(
        is_tool ? BLOCKS : rigids[index].first_coarse_index, is_tool ? 1 : rigids[index].block_count, turn);
    RigidIterate now = iterates[set * RIGIDS + index];
    for (int k = 0; k < 6; k++) {
        now.p[k] = now.u[k] + scalars.beta * now.p[k];
        now.s[k] = rows[k] + scalars.beta * now.s[k];
        now.x[k] += scalars.alpha * now.p[k];
        now.r[k] -= scalars.alpha * now.s[k];
        rigid_x[k] = now.x[k];
    }
    residual = now.r;
    if (!writes) return;
    uint next = (1 - set) * RIGIDS + index;
    iterates[next].x = now.x;
    iterates[next].r = now.r;
    iterates[next].p = now.p;
    iterates[next].s = now.s;
}

// New residual of a core, for a workgroup that updates another core of the same group.
float[6] residual_of(uint index, Scalars scalars) {
    vec4 turn = fetch(block_turns, rigids[index].block_first);
    float rows[6] = twist_of_restricted_product(rigids[index].first_coarse_index, rigids[index].block_count, turn);
    RigidIterate now = iterates[set * RIGIDS + index];
    for (int k = 0; k < 6; k++) now.r[k] -= scalars.alpha * (rows[k] + scalars.beta * now.s[k]);
    return now.r;
}

void update_tool(Scalars scalars) {
    if (gl_LocalInvocationID.x != 0) return;
    float residual[6];
    update_rigid(RIGIDS - 1, vec4(0.0, 0.0, 0.0, 1.0), scalars, true, residual);
    for (uint i = 0; i < 6; i++) {
        float sum = 0.0;
        uint row = inverse_row(RIGIDS - 1, i);
        for (uint k = 0; k < 6; k++) sum += rigid_inverses[row + k] * residual[k];
        if (scalars.clears_u) sum = 0.0;
        iterates[(1 - set) * RIGIDS + RIGIDS - 1].u[i] = sum;
    }
}

// Updates a core and the nodes of one of its blocks; `coarse_vector` is the coarse correction of u.
void update_attached(uint b, Block block, vec4 turn, CoarseVector coarse_vector, Scalars scalars) {
    Rigid own = rigids[block.rigid];
    bool writes = b == own.block_first;
    // New residuals of every core of the group, for the product with the group's inverse.
    for (uint k = gl_LocalInvocationID.x; k < own.group_count; k += SIZE) {
        float residual[6];
        uint index = own.group_first + k;
        if (index == block.rigid) update_rigid(index, turn, scalars, writes, residual);
        else residual = residual_of(index, scalars);
        for (int i = 0; i < 6; i++) group_residuals[6 * k + i] = residual[i];
    }
    barrier();
    vec3 c0 = coarse_vector.c0, c1 = coarse_vector.c1;
    float coarse[6] = float[6](c0.x, c0.y, c0.z, c1.x, c1.y, c1.z);
    for (uint i = gl_LocalInvocationID.x; i < 6; i += SIZE) {
        float sum = 0.0;
        uint row = inverse_row(block.rigid, i);
        for (uint k = 0; k < 6 * own.group_count; k++) sum += rigid_inverses[row + k] * group_residuals[k];
        rigid_u[i] = scalars.clears_u ? 0.0 : sum + coarse[i];
        if (writes) iterates[(1 - set) * RIGIDS + block.rigid].u[i] = rigid_u[i];
    }
    barrier();
    for (uint at = gl_LocalInvocationID.x; at < block.count; at += SIZE) {
        uint i = block_node(block, at).x;
        vec3 arm = rotate(turn, fetch(node_rest, i).xyz);
        store(solution, i, vec4(carry(rigid_x, arm), 0.0));
        next_preconditioned[i] = vec4(carry(rigid_u, arm), 0.0);
    }
}

// Updates the free nodes of a block; `coarse_vector` is the coarse correction of u.
void update_free(Block block, vec4 place, CoarseVector coarse_vector, Scalars scalars) {
    for (uint at = gl_LocalInvocationID.x; at < block.count; at += SIZE) {
        uint i = block_node(block, at).x;
        vec3 p = fetch(preconditioned, i).xyz + scalars.beta * fetch(direction, i).xyz;
        vec3 s = fetch(operator_product, i).xyz + scalars.beta * fetch(direction_product, i).xyz;
        next_direction[i] = vec4(p, 0.0);
        next_direction_product[i] = vec4(s, 0.0);
        store(solution, i, vec4(fetch(solution, i).xyz + scalars.alpha * p, 0.0));
        vec3 r = fetch(residual, i).xyz - scalars.alpha * s;
        next_residual[i] = vec4(r, 0.0);
        vec3 u = precondition(i, r, coarse_vector, COARSE ? (fetch(node_rest, i).xyz - place.xyz) * place.w : vec3(0.0));
        next_preconditioned[i] = vec4(scalars.clears_u ? vec3(0.0) : u, 0.0);
    }
}

void main() {
    Scalars scalars;
    bool goes_on = next_scalars(scalars);
    if (!is_running() || !goes_on) return;
    if (ROLE == TOOL_ROWS) {
        update_tool(scalars);
        return;
    }
    uint b = FIRST + gl_WorkGroupID.x;
    Block block = block_of(b);
    vec4 turn = fetch(block_turns, b);
    CoarseVector coarse_vector = coarse_zero();
    if (COARSE) {
        vec4 z[3] = coarse_correction(b, scalars);
        coarse_vector = to_world(unpacked(z[0], z[1], z[2]), turn);
    }
    if (ROLE == ATTACHED_NODES) update_attached(b, block, turn, coarse_vector, scalars);
    else update_free(block, fetch(block_places, b), coarse_vector, scalars);
}
