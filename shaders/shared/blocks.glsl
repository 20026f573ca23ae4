// Blocks of nodes, each worked on by one workgroup of the solver's kernels: first blocks of neighbouring free nodes of
// one frame, also aggregates of the coarse space, then blocks of nodes attached to one dynamic core. Needs `blocks`,
// `block_nodes`.

struct Block {
    uint first, count;          // its nodes, a range of block_nodes
    uint frame;                 // the rigid coordinate frame of its nodes
    uint rigid;                 // the dynamic core that its nodes are attached to, or NONE
};

Block block_of(uint b) {
    uvec4 x = fetch(blocks, b);
    return Block(x.x, x.y, x.z, x.w);
}

// The k-th node of a block: index, first of its texels in `node_elements`, number of these, bits of its damping.
uvec4 block_node(Block block, uint k) { return fetch(block_nodes, block.first + k); }

// Mass-proportional damping alpha m of a node, kg/s.
float node_damping(uvec4 node) { return uintBitsToFloat(node.w); }

// Place of a block's modes among those of all blocks, body by body. Needs `coarse_blocks`.
uint coarse_index_of(uint b) { return fetch(coarse_blocks, b).w; }
