#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Solve: the coarse level outside the loop, z = A_c^-1 P^T b of each block and its share of inner products; before the first
// iteration also of A x, for the warm start. Two-level additive Schwarz (Dryja and Widlund 1987) with affine modes of
// aggregates and the matrix at rest. A workgroup a block. Oracle: oracle::coarse.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const bool WARM = true;         // else only b, then what is left of it at the end

layout(binding = 0) uniform usamplerBuffer coarse_blocks;
layout(binding = 1) uniform usamplerBuffer coarse_inverse;
layout(binding = 2) uniform samplerBuffer coarse_scales;
layout(binding = 3) uniform samplerBuffer restricted_rhs;           // P^T b
layout(binding = 4) uniform samplerBuffer restricted_image;         // P^T A x
layout(scalar, binding = 5) writeonly buffer CoarseRhs { vec4 coarse_rhs[]; };          // A_c^-1 P^T b, three a slot
layout(scalar, binding = 6) writeonly buffer CoarseImage { vec4 coarse_image[]; };      // A_c^-1 P^T A x
layout(scalar, binding = 7) writeonly buffer CoarseDots { vec4 coarse_dots[]; };        // b.z_b, Ax.z_b, Ax.z_Ax

const uint SUMS = 6;

#include "shared/sums.glsl"
#include "shared/coarse.glsl"

vec4 scaled(samplerBuffer modes, CoarseBlock block, uint k) {
    uint at = block.first + k;
    return k < block.texels ? coarse_scale(at) * texelFetch(modes, int(at)) : vec4(0.0);
}

void main() {
    uint b = gl_WorkGroupID.x;
    CoarseBlock block = coarse_block(b);
    vec4 of_rhs[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), of_image[3] = of_rhs;
    for (uint k = gl_LocalInvocationID.x; k < row_texels(block); k += SIZE) {
        add_products(of_rhs, block, k, scaled(restricted_rhs, block, 2 * k), scaled(restricted_rhs, block, 2 * k + 1));
        if (WARM) add_products(of_image, block, k, scaled(restricted_image, block, 2 * k), scaled(restricted_image, block, 2 * k + 1));
    }
    vec4 totals[SUMS] = vec4[SUMS](of_rhs[0], of_rhs[1], of_rhs[2], of_image[0], of_image[1], of_image[2]);
    workgroup_sums(totals, WARM ? 6 : 3);
    if (gl_LocalInvocationID.x != 0) return;
    vec4 sums = vec4(0.0);
    for (int row = 0; row < 3; row++) {
        uint at = block.own + row;
        vec4 scale = block.texels > 0 ? coarse_scale(at) : vec4(0.0);
        coarse_rhs[at] = scale * totals[row];
        sums.x += block.texels > 0 ? dot(texelFetch(restricted_rhs, int(at)), scale * totals[row]) : 0.0;
        if (!WARM) continue;
        coarse_image[at] = scale * totals[3 + row];
        if (block.texels == 0) continue;
        vec4 image = texelFetch(restricted_image, int(at));
        sums.yz += vec2(dot(image, scale * totals[row]), dot(image, scale * totals[3 + row]));
    }
    coarse_dots[b] = sums;
}
