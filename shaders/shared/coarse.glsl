// Coarse space of the two-level additive Schwarz preconditioner. A body's nodes are divided into blocks (aggregates);
// each block has twelve modes, motions that are the basis of the coarse space (shared/coarse_vector.glsl). Over the
// modes of all blocks of a body, the Galerkin matrix is A_c = P^T A P, with the operator A of the body at rest,
// without contacts, and the prolongation P from modes to nodes. Its inverse A_c^-1 has twelve rows for each block; it
// is scaled to a unit diagonal and kept in half precision, eight numbers in a texel.
//
// An including shader declares three arrays: `coarse_inverse` holds the rows of A_c^-1. `coarse_scales` holds the
// square roots of the diagonal of A_c^-1, three texels for each block. `coarse_blocks` holds for each block: first
// texel of its rows, index of its body's first block, a quarter of the number of its body's modes (zero if the body has
// no coarse space), index of the block itself; the indices count all blocks that have modes.

struct CoarseBlock {
    uint matrix;                // first texel of the block's rows in coarse_inverse
    uint first;                 // first texel of the body's modes, of which a texel holds four
    uint texels;                // texels of the body's modes; 0: the body has no coarse space
    uint own;                   // first texel of the block's own modes
};

CoarseBlock coarse_block(uint b) {
    uvec4 x = fetch(coarse_blocks, b);
    return CoarseBlock(x.x, 3 * x.y, x.z, 3 * x.w);
}

// Number of texels of a row of A_c^-1, which hold eight numbers each.
uint row_texels(CoarseBlock block) { return (block.texels + 1) / 2; }

vec4 coarse_scale(uint at) { return fetch(coarse_scales, at); }

// `products` are a block's twelve rows of A_c^-1 times a vector over the modes. Adds the terms of eight entries of that
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
