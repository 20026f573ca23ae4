#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Solve: coarse correction z = A_c^-1 P^T b of the two-level additive Schwarz preconditioner (Dryja and Widlund 1987),
// for the linear system A x = b, and inner products with z. P^T restricts to the modes, which are affine motions of the
// preconditioner's aggregates and span its coarse space (shared/coarse_vector.glsl); A_c is the Galerkin matrix of the
// modes at rest (shared/coarse.glsl). The kernel runs twice in a solve: before the loop of iterations, for b and, for
// the warm start, also for A x and A d with the last solution x and the trend d, which is the difference of the last two
// solutions; and after the loop, for b - A x in place of b. One workgroup
// runs for each aggregate, which is a block (the nodes that one workgroup of the solver works on). The f64 reference is
// oracle::coarse.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const bool WARM_START = true;  // true: before the loop; false: after it

READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(uvec4, coarse_inverse);
READ_ONLY(vec4, coarse_scales);
READ_ONLY(vec4, restricted_rhs);           // P^T b, three texels per block; after the loop P^T (b - A x)
READ_ONLY(vec4, restricted_product);         // P^T A x
READ_ONLY(vec4, restricted_trend);           // P^T A d
layout(scalar) writeonly buffer CoarseRhs { vec4 coarse_rhs[]; };          // z_b = A_c^-1 P^T b, three texels per block
layout(scalar) writeonly buffer CoarseProduct { vec4 coarse_product[]; };      // A_c^-1 P^T A x
layout(scalar) writeonly buffer CoarseTrend { vec4 coarse_trend[]; };          // A_c^-1 P^T A d
layout(scalar) writeonly buffer CoarseDots { float coarse_dots[]; };           // a block's share of P^T b . z_b

const uint SUMS = 9;

#include "shared/sums.glsl"
#include "shared/coarse.glsl"

// Texel k of the body's part of P^T b, P^T A x or P^T A d: four entries, each multiplied by its mode's scale; zero beyond
// the last texel.
vec4 scaled_rhs(CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * fetch(restricted_rhs, at) : vec4(0.0);
}

vec4 scaled_product(CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * fetch(restricted_product, at) : vec4(0.0);
}

vec4 scaled_trend(CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * fetch(restricted_trend, at) : vec4(0.0);
}

void main() {
    uint b = gl_WorkGroupID.x;
    CoarseBlock block = coarse_block(b);
    vec4 of_rhs[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), of_product[3] = of_rhs, of_trend[3] = of_rhs;
    for (uint k = gl_LocalInvocationID.x; k < row_texels(block); k += SIZE) {
        add_products(of_rhs, block, k, scaled_rhs(block, 2 * k), scaled_rhs(block, 2 * k + 1));
        if (!WARM_START) continue;
        add_products(of_product, block, k, scaled_product(block, 2 * k), scaled_product(block, 2 * k + 1));
        add_products(of_trend, block, k, scaled_trend(block, 2 * k), scaled_trend(block, 2 * k + 1));
    }
    vec4 totals[SUMS] = vec4[SUMS](of_rhs[0], of_rhs[1], of_rhs[2], of_product[0], of_product[1], of_product[2],
        of_trend[0], of_trend[1], of_trend[2]);
    workgroup_sums(totals, WARM_START ? 9 : 3);
    if (gl_LocalInvocationID.x != 0) return;
    float sum = 0.0;
    for (int row = 0; row < 3; row++) {
        uint at = block.own + row;
        vec4 scale = block.texels > 0 ? coarse_scale(at) : vec4(0.0);
        coarse_rhs[at] = scale * totals[row];
        sum += block.texels > 0 ? dot(fetch(restricted_rhs, at), scale * totals[row]) : 0.0;
        if (!WARM_START) continue;
        coarse_product[at] = scale * totals[3 + row];
        coarse_trend[at] = scale * totals[6 + row];
    }
    coarse_dots[b] = sum;
}
