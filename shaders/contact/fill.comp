#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Contact: entries into their node's run, in no particular order yet. One invocation an entry (16 a contact).
// Oracle: the index sorted by its test.

layout(local_size_x_id = 0) in;

layout(scalar, binding = 0) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 1) readonly buffer Contacts { Contact contacts[]; };
layout(scalar, binding = 2) readonly buffer EntryNodes { uint entry_nodes[]; };
layout(scalar, binding = 3) readonly buffer EntryWeights { float entry_weights[]; };
layout(scalar, binding = 4) buffer Cursor { uint cursor[]; };
layout(scalar, binding = 5) writeonly buffer Unsorted { uint unsorted[]; };

void main() {
    uint e = gl_GlobalInvocationID.x;
    if (e >= 16 * counts.contacts || (e % 16) / 4 >= contacts[e / 16].quads || entry_weights[e] == 0.0) return;
    unsorted[atomicAdd(cursor[entry_nodes[e]], 1)] = e;
}
