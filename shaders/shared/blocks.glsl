// Blocks of nodes, a workgroup each: free nodes of one frame that lie together, which are also an aggregate of the coarse
// level, or, after all of those, nodes that one dynamic core carries. Needs `blocks` and `block_nodes`.

struct Block {
    uint first, count;          // into block_nodes
    uint frame;
    uint rigid;                 // the core that carries them, or NONE
};

Block block_of(uint b) {
    uvec4 x = fetch(blocks, b);
    return Block(x.x, x.y, x.z, x.w);
}

// Node, first quad of elements, quads, bits of its damping.
uvec4 block_node(Block block, uint k) { return fetch(block_nodes, block.first + k); }

// alpha m, kg/s.
float node_damping(uvec4 node) { return uintBitsToFloat(node.w); }

// Where its modes are among those of all blocks: a body's lie together. Needs `coarse_blocks`.
uint slot_of(uint b) { return fetch(coarse_blocks, b).w; }
