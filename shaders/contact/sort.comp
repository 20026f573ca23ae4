#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Contact: entries within their node's run by rank, so that sums over a run have one order. One invocation an entry.
// Oracle: the index sorted by its test.

layout(local_size_x_id = 0) in;

layout(scalar, binding = 0) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 1) readonly buffer Contacts { Contact contacts[]; };
layout(scalar, binding = 2) readonly buffer EntryNodes { uint entry_nodes[]; };
layout(scalar, binding = 3) readonly buffer EntryWeights { float entry_weights[]; };
layout(scalar, binding = 4) readonly buffer NodeEntries { uvec2 node_entries[]; };
layout(scalar, binding = 5) readonly buffer Unsorted { uint unsorted[]; };
layout(scalar, binding = 6) writeonly buffer Sorted { uvec2 sorted[]; };       // contact, bits of the weight

void main() {
    uint e = gl_GlobalInvocationID.x;
    if (e >= 16 * counts.contacts || (e % 16) / 4 >= contacts[e / 16].quads || entry_weights[e] == 0.0) return;
    uvec2 run = node_entries[entry_nodes[e]];
    uint rank = 0;
    for (uint k = 0; k < run.y; k++) rank += unsorted[run.x + k] < e ? 1 : 0;
    sorted[run.x + rank] = uvec2(e / 16, floatBitsToUint(entry_weights[e]));
}
