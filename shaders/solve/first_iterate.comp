#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Solve: the first iterate of conjugate gradients, from the last solution x' and the trend d, which is the difference of
// the last two solutions, with the factors `warm_start` (f, g) that solve/first_residual computed: solution
// x = f x' + g d, residual r = b - f A x' - g A d, u = M^-1 r, search direction zero, with operator A, right-hand side b
// and preconditioner M. In a step's first solve it writes -x' to the trend, to which solve/commit adds the step's
// solution. P^T restricts to the coarse space of M, whose matrix is A_c (shared/preconditioner.glsl). Nodes attached to
// a rigid core (rigid body inside a soft one) take their values from the core's iterate. One workgroup runs for each
// block of nodes. The f64 reference is oracle::step. A block is a set of nodes that one workgroup works on, a frame a
// rigid coordinate frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool SUPPORTS = false;         // whether some nodes are supported (shared/support.glsl)

layout(scalar) readonly buffer SolveIn { Solve solve; };
READ_ONLY(vec4, block_turns);                           // rotation of each block, world
READ_ONLY(uvec4, blocks);
READ_ONLY(uvec4, block_nodes);
READ_ONLY(vec4, block_places);  // xyz: middle of a block in its frame, m; w: 1 / the block's size, 1/m
READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, rhs);
READ_ONLY(vec4, operator_product);            // A x'
READ_ONLY(vec4, trend_product);               // A d
READ_ONLY(vec4, inverse);
READ_ONLY(vec4, blocks_without_contacts);     // E of shared/preconditioner.glsl, two texels per node
READ_ONLY(vec4, coarse_rhs);       // A_c^-1 P^T b, three texels per block
READ_ONLY(vec4, coarse_product);     // A_c^-1 P^T A x'
READ_ONLY(vec4, coarse_trend);       // A_c^-1 P^T A d
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
READ_WRITE(vec4, solution);      // x' before, x after
READ_WRITE(vec4, trend);         // d before; -x' after a step's first solve
layout(scalar) writeonly buffer Residual { vec4 residual[]; };
layout(scalar) writeonly buffer Preconditioned { vec4 preconditioned[]; };
layout(scalar) writeonly buffer Direction { vec4 direction[]; };                          // search direction p
layout(scalar) writeonly buffer DirectionProduct { vec4 direction_product[]; };               // A p
layout(scalar) writeonly buffer RestrictedDirection { vec4 restricted_direction[]; };     // P^T A p, zero at first

#include "shared/blocks.glsl"
#include "shared/coarse_vector.glsl"
#include "shared/symmetric.glsl"

const bool SMOOTHS = CONTACT || SUPPORTS;     // whether P differs from P_0 (shared/preconditioner.glsl)
#include "shared/preconditioner.glsl"
#include "shared/core.glsl"
#include "shared/start.glsl"

// Coarse correction of a block, A_c^-1 P^T r, in world axes.
CoarseVector coarse_start(uint coarse_index, vec4 turn) {
    vec4 z[3];
    for (int k = 0; k < 3; k++) {
        z[k] = fetch(coarse_rhs, 3 * coarse_index + k);
        if (solve.warm_start[0] != 0.0) z[k] -= solve.warm_start[0] * fetch(coarse_product, 3 * coarse_index + k);
        if (solve.warm_start[1] != 0.0) z[k] -= solve.warm_start[1] * fetch(coarse_trend, 3 * coarse_index + k);
    }
    return to_world(unpacked(z[0], z[1], z[2]), turn);
}

void main() {
    uint b = gl_WorkGroupID.x;
    Block block = block_of(b);
    vec4 place = fetch(block_places, b), turn = fetch(block_turns, b);
    CoarseVector coarse_vector = coarse_zero();
    if (COARSE) {
        uint coarse_index = coarse_index_of(b);
        coarse_vector = coarse_start(coarse_index, turn);
        if (gl_LocalInvocationID.x < 3) restricted_direction[3 * coarse_index + gl_LocalInvocationID.x] = vec4(0.0);
    }
    float f = solve.warm_start[0], g = solve.warm_start[1];
    bool begins = begins_step(solve);
    for (uint at = gl_LocalInvocationID.x; at < block.count; at += SIZE) {
        uint i = block_node(block, at).x;
        vec3 rest = fetch(node_rest, i).xyz;
        // Vectors are skipped where their factors are zero, because they may hold NaN after a failed step.
        vec4 last = f != 0.0 ? fetch(solution, i) : vec4(0.0);
        vec4 start = f * last;
        if (g != 0.0) start += g * fetch(trend, i);
        if (begins) store(trend, i, -last);
        direction[i] = vec4(0.0);
        direction_product[i] = vec4(0.0);
        if (block.rigid != NONE) {
            vec3 arm = rotate(turn, rest);
            store(solution, i, vec4(carry(iterates[block.rigid].x, arm), 0.0));
            preconditioned[i] = vec4(carry(iterates[block.rigid].u, arm), 0.0);
            residual[i] = vec4(0.0);
            continue;
        }
        vec3 r = fetch(rhs, i).xyz;
        if (f != 0.0) r -= f * fetch(operator_product, i).xyz;
        if (g != 0.0) r -= g * fetch(trend_product, i).xyz;
        vec3 u = precondition(i, r, coarse_vector, (rest - place.xyz) * place.w);
        store(solution, i, start);
        residual[i] = vec4(r, 0.0);
        preconditioned[i] = vec4(u, 0.0);
    }
}
