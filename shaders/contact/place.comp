#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Contact: room for each touched node's entries in the transposed index, and a list of those nodes. Where a node's run lies
// depends on the order of the appends, what is in it does not. The counts go back to zero for the next step. One invocation
// a node. Oracle: the index sorted by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;

layout(scalar, binding = 0) buffer NodeCount { uint node_count[]; };
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) writeonly buffer NodeEntries { uvec2 node_entries[]; };   // first, count
layout(scalar, binding = 3) writeonly buffer Cursor { uint cursor[]; };
layout(scalar, binding = 4) writeonly buffer TouchedNodes { uint touched_nodes[]; };
layout(scalar, binding = 5) buffer Args { uint args[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    uint count = node_count[i];
    if (count == 0) {
        node_entries[i] = uvec2(0);
        return;
    }
    uint first = atomicAdd(counts.entries, count);
    node_entries[i] = uvec2(first, count);
    cursor[i] = first;
    node_count[i] = 0;
    touched_nodes[atomicAdd(args[3 * ARGS_NODES], 1)] = i;
}
