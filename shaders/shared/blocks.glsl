// Blocks of nodes, a workgroup each: free nodes of one frame that lie together, which are also an aggregate of the coarse
// level, or nodes that one dynamic core carries. Needs `blocks`, `block_nodes` and `frames`.

struct Block {
    uint first, count;          // into block_nodes
    uint frame;
    uint rigid;                 // the core that carries them, or NONE
};

Block block_of(uint b) {
    uvec4 x = texelFetch(blocks, int(b));
    return Block(x.x, x.y, x.z, x.w);
}

// Node, first quad of elements, quads.
uvec4 block_node(Block block, uint k) { return texelFetch(block_nodes, int(block.first + k)); }
