// A block is a set of nodes of soft bodies that one workgroup of the solver's kernels works on. Blocks of free nodes
// come first: nodes of one frame (rigid coordinate frame), which are also an aggregate of the preconditioner's coarse
// space if their body has one. Blocks of nodes attached to one dynamic core (rigid core inside a soft body) follow.
// An including shader declares `blocks` and `block_nodes`.

struct Block {
    uint first, count;          // its nodes, a range of block_nodes
    uint frame;                 // the rigid coordinate frame of its nodes
    uint rigid;                 // the dynamic core that its nodes are attached to, or NONE
};

Block block_of(uint b) {
    uvec4 x = fetch(blocks, b);
    return Block(x.x, x.y, x.z, x.w);
}

// The k-th node of a block: node index; first texel and number of texels of the node in `node_elements`, the lists of
// forces of elements on nodes, or in solve/gather with an assembled operator its row (shared/rows.glsl); damping (bits
// of a float).
uvec4 block_node(Block block, uint k) { return fetch(block_nodes, block.first + k); }

// Mass-proportional damping alpha m of a node, kg/s: damping coefficient alpha (1/s) times the node's mass m.
float node_damping(uvec4 node) { return uintBitsToFloat(node.w); }

// Index of a block's modes (basis of the coarse space) among the modes of all blocks, which are stored body by body. An
// including shader declares `coarse_blocks`.
uint coarse_index_of(uint b) { return fetch(coarse_blocks, b).w; }
