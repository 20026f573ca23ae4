#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Contact: a node's entries in ascending order, so that sums over them have one order: a bit each entry of a window, then the
// set bits in turn. One workgroup a touched node. Oracle: the index sorted by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar, binding = 0) readonly buffer TouchedNodes { uint touched_nodes[]; };
layout(scalar, binding = 1) readonly buffer NodeEntries { uvec2 node_entries[]; };
layout(scalar, binding = 2) readonly buffer Unsorted { uint unsorted[]; };
layout(scalar, binding = 3) readonly buffer EntryWeights { float entry_weights[]; };
layout(scalar, binding = 4) writeonly buffer Sorted { uvec2 sorted[]; };       // contact, bits of the weight

const uint WORDS = 1024;        // of a window of 32 WORDS entries, 2,048 contacts

shared uint bits[WORDS];
shared uint totals[SIZE];
shared uint range[2];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uvec2 run = node_entries[touched_nodes[gl_WorkGroupID.x]];
    if (lane == 0) {
        range[0] = NONE;
        range[1] = 0;
    }
    barrier();
    uint least = NONE, greatest = 0;
    for (uint k = run.x + lane; k < run.x + run.y; k += SIZE) {
        least = min(least, unsorted[k]);
        greatest = max(greatest, unsorted[k]);
    }
    atomicMin(range[0], least);
    atomicMax(range[1], greatest);
    barrier();
    uint at = run.x;
    for (uint window = range[0] / 32; window <= range[1] / 32; window += WORDS) {
        uint words = min(WORDS, range[1] / 32 - window + 1);
        for (uint w = lane; w < words; w += SIZE) bits[w] = 0;
        barrier();
        for (uint k = run.x + lane; k < run.x + run.y; k += SIZE) {
            uint e = unsorted[k];
            uint word = e / 32 - window;
            if (word < words) atomicOr(bits[word], 1u << e % 32);
        }
        barrier();
        uint share = (words + SIZE - 1) / SIZE;
        uint begin = min(lane * share, words), end = min(begin + share, words);
        uint own = 0;
        for (uint w = begin; w < end; w++) own += bitCount(bits[w]);
        totals[lane] = own;
        barrier();
        uint place = at;
        for (uint k = 0; k < SIZE; k++) {
            if (k < lane) place += totals[k];
            at += totals[k];
        }
        for (uint w = begin; w < end; w++) {
            for (uint left = bits[w]; left != 0; left &= left - 1) {
                uint e = 32 * (window + w) + findLSB(left);
                sorted[place++] = uvec2(e / 16, floatBitsToUint(entry_weights[e]));
            }
        }
        barrier();
    }
}
