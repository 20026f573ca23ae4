// The coarse level: what A does to the modes of a body's blocks, at rest, inverted. A block has twelve rows of that, each as
// long as its body has modes. Needs `coarse_blocks` (first texel of its rows, first slot of its body, texels in a row: none
// where the body has no coarse level; its slot) and `coarse_inverse`.

struct CoarseBlock {
    uint matrix;
    uint first;                 // texel of the body's first slot
    uint texels;                // of four modes each
};

CoarseBlock coarse_block(uint b) {
    uvec4 x = texelFetch(coarse_blocks, int(b));
    return CoarseBlock(x.x, 3 * x.y, x.z);
}

// What the texel `k` of modes gives to the block's twelve products.
vec4[3] coarse_products(CoarseBlock block, uint k, vec4 modes) {
    vec4 products[3];
    for (uint row = 0; row < 3; row++) {
        for (uint j = 0; j < 4; j++) {
            products[row][j] = dot(texelFetch(coarse_inverse, int(block.matrix + (4 * row + j) * block.texels + k)), modes);
        }
    }
    return products;
}
