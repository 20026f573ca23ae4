#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Contact: room for each touched node's entries in the transposed index. Where a node's run lies depends on the order of
// the appends, what is in it does not. One invocation a node. Oracle: the index sorted by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;

layout(scalar, binding = 0) readonly buffer NodeCount { uint node_count[]; };
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) writeonly buffer NodeEntries { uvec2 node_entries[]; };   // first, count; cleared
layout(scalar, binding = 3) writeonly buffer Cursor { uint cursor[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES || node_count[i] == 0) return;
    uint first = atomicAdd(counts.entries, node_count[i]);
    node_entries[i] = uvec2(first, node_count[i]);
    cursor[i] = first;
}
