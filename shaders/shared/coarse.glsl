// Coarse space of the two-level additive Schwarz preconditioner: A_c^-1, the inverse of the Galerkin matrix of a body
// at rest, A_c = P^T A P (A the operator, P the prolongation from the modes), over the modes (basis) of all its blocks
// of nodes (aggregates; shared/coarse_vector.glsl). A_c^-1 is scaled to a unit diagonal and kept in half precision,
// eight numbers in a texel. A block has twelve modes, hence twelve rows.
//
// An including shader declares three arrays: `coarse_inverse` holds the rows of A_c^-1. `coarse_scales` holds the
// square roots of the diagonal of A_c^-1, three texels for each block. `coarse_blocks` holds for each block: first
// texel of its rows, index of the body's first block, a quarter of the number of the body's modes (zero where it has no
// coarse space), index of the block itself; the indices count all blocks that have modes.

struct CoarseBlock {
    uint matrix;                // first texel of its rows
    uint first;                 // texel of the body's first modes, four modes each
    uint texels;                // texels of the body's modes; 0: the body has no coarse space
    uint own;                   // texel of the block's own modes
};

CoarseBlock coarse_block(uint b) {
    uvec4 x = fetch(coarse_blocks, b);
    return CoarseBlock(x.x, 3 * x.y, x.z, 3 * x.w);
}

// Texels of a row of the inverse, eight numbers each.
uint row_texels(CoarseBlock block) { return (block.texels + 1) / 2; }

vec4 coarse_scale(uint at) { return fetch(coarse_scales, at); }

// Adds to `products`, a block's twelve rows of A_c^-1 times a vector over the modes, the terms of eight entries of that
// vector: `low` and `high`, already multiplied by their scales. `k` is the texel of these entries in a row.
void add_products(inout vec4 products[3], CoarseBlock block, uint k, vec4 low, vec4 high) {
    uint stride = row_texels(block);
    for (uint row = 0; row < 3; row++) {
        for (uint j = 0; j < 4; j++) {
            uvec4 halves = fetch(coarse_inverse, block.matrix + (4 * row + j) * stride + k);
            products[row][j] += dot(vec4(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y)), low)
                + dot(vec4(unpackHalf2x16(halves.z), unpackHalf2x16(halves.w)), high);
        }
    }
}
