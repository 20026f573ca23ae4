// The coarse level: what A does to the modes of a body's blocks, at rest, inverted and scaled to a diagonal of one, in half
// precision: eight numbers a texel. A block has twelve rows of that, each as long as its body has modes. Needs
// `coarse_blocks` (first texel of its rows, first slot of its body, modes of that over four: none where the body has no
// coarse level; its slot), `coarse_inverse` and `coarse_scales` (three a slot: the roots of the inverse's diagonal).

struct CoarseBlock {
    uint matrix;
    uint first;                 // texel of the body's first modes, four each
    uint texels;
    uint own;                   // texel of its own
};

CoarseBlock coarse_block(uint b) {
    uvec4 x = fetch(coarse_blocks, b);
    return CoarseBlock(x.x, 3 * x.y, x.z, 3 * x.w);
}

// Texels of a row of the inverse.
uint row_texels(CoarseBlock block) { return (block.texels + 1) / 2; }

vec4 coarse_scale(uint at) { return fetch(coarse_scales, at); }

// What eight scaled modes, those of the texel `k` of a row, give to the block's twelve products.
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
