#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Solve: coarse correction before and after the solver's loop, z = A_c^-1 P^T b for each block of nodes (set of nodes
// that one workgroup works on), with its part of inner products; before the first iteration also that of A x, with the
// last solution x, for the warm start. Two-level additive Schwarz preconditioner (Dryja and Widlund 1987): P^T
// restricts to the affine modes of aggregates (the blocks), and A_c is the Galerkin matrix at rest
// (shared/coarse.glsl). One workgroup runs for each block. The f64 reference is oracle::coarse. Modes are the basis of
// the preconditioner's coarse space (shared/coarse_vector.glsl).

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const bool WARM_START = true;  // true: before the loop, for b and A x; false: after it

READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(uvec4, coarse_inverse);
READ_ONLY(vec4, coarse_scales);
READ_ONLY(vec4, restricted_rhs);           // P^T b, three texels per block; after the loop P^T (b - A x)
READ_ONLY(vec4, restricted_product);         // P^T A x
layout(scalar) writeonly buffer CoarseRhs { vec4 coarse_rhs[]; };          // z_b = A_c^-1 P^T b, three texels per block
layout(scalar) writeonly buffer CoarseProduct { vec4 coarse_product[]; };      // z_Ax = A_c^-1 P^T A x
layout(scalar) writeonly buffer CoarseDots { vec4 coarse_dots[]; };        // b . z_b, A x . z_b, A x . z_Ax of a block

const uint SUMS = 6;

#include "shared/sums.glsl"
#include "shared/coarse.glsl"

// Four scaled modes of P^T b, at texel k of the body; zero beyond the body's last texel.
vec4 scaled_rhs(CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * fetch(restricted_rhs, at) : vec4(0.0);
}

// Four scaled modes of P^T A x, at texel k of the body; zero beyond the body's last texel.
vec4 scaled_product(CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * fetch(restricted_product, at) : vec4(0.0);
}

void main() {
    uint b = gl_WorkGroupID.x;
    CoarseBlock block = coarse_block(b);
    vec4 of_rhs[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), of_product[3] = of_rhs;
    for (uint k = gl_LocalInvocationID.x; k < row_texels(block); k += SIZE) {
        add_products(of_rhs, block, k, scaled_rhs(block, 2 * k), scaled_rhs(block, 2 * k + 1));
        if (WARM_START) add_products(of_product, block, k, scaled_product(block, 2 * k), scaled_product(block, 2 * k + 1));
    }
    vec4 totals[SUMS] = vec4[SUMS](of_rhs[0], of_rhs[1], of_rhs[2], of_product[0], of_product[1], of_product[2]);
    workgroup_sums(totals, WARM_START ? 6 : 3);
    if (gl_LocalInvocationID.x != 0) return;
    vec4 sums = vec4(0.0);
    for (int row = 0; row < 3; row++) {
        uint at = block.own + row;
        vec4 scale = block.texels > 0 ? coarse_scale(at) : vec4(0.0);
        coarse_rhs[at] = scale * totals[row];
        sums.x += block.texels > 0 ? dot(fetch(restricted_rhs, at), scale * totals[row]) : 0.0;
        if (!WARM_START) continue;
        coarse_product[at] = scale * totals[3 + row];
        if (block.texels == 0) continue;
        vec4 operator_product = fetch(restricted_product, at);
        sums.yz += vec2(dot(operator_product, scale * totals[row]), dot(operator_product, scale * totals[3 + row]));
    }
    coarse_dots[b] = sums;
}
