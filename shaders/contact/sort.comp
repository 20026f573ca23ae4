#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rounds.glsl"

// Contact stage of a step: sorts the entries of each node (an entry is a contact and its weight on the node), which
// contact/response put on lists, so that sums over entries have a fixed order. A window of entries is marked in a
// bitmask in shared memory, one bit for each entry, and the entries of the set bits are written in ascending order.
// Where a node's range of entries begins depends on the order in which workgroups run; the contents of the range do
// not. The node's lists and their count are cleared for the next step. One workgroup runs for each node with contacts,
// one lane for each list. The test compares with an index sorted on the CPU.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar) readonly buffer TouchedNodes { uint touched_nodes[]; };
layout(scalar) buffer NodeListCounts { uint node_list_counts[]; };  // number of each node's lists that are in use
layout(scalar) buffer NodeLists { uint node_lists[]; };  // head of each list, SIZE per node; see contact/response
layout(scalar) readonly buffer NextEntries { uint next_entries[]; };    // the entry after each in its list
layout(scalar) readonly buffer EntryWeights { float entry_weights[]; };
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) writeonly buffer NodeEntries { uvec2 node_entries[]; };  // range of each node in `sorted`: first, length
layout(scalar) writeonly buffer Sorted { uvec2 sorted[]; };       // contact, bits of the weight

const uint WORDS = 2048;        // words of the bitmask: its window has 32 x WORDS bits, for entries of 4,096 contacts
// A number above every index of an entry; shared/ray_hit.glsl explains why loops test against it.
const uint ALL_ENTRIES = 0x80000000u;

shared uint bits[WORDS];
shared uint totals[SIZE];
shared uint range[2];
shared uvec2 run;

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint node = touched_nodes[gl_WorkGroupID.x];
    uint head = node_lists[node * SIZE + lane];
    node_lists[node * SIZE + lane] = NONE;
    if (lane == 0) {
        node_list_counts[node] = 0;
        run = uvec2(0);
        range[0] = NONE;
        range[1] = 0;
    }
    barrier();
    uint least = NONE, greatest = 0, count = 0, entry = head;
    while (entry < ALL_ENTRIES && count < MOST_ROUNDS) {
        count++;
        least = min(least, entry);
        greatest = max(greatest, entry);
        entry = next_entries[entry];
    }
    atomicMin(range[0], least);
    atomicMax(range[1], greatest);
    atomicAdd(run.y, count);
    if (entry != NONE) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    barrier();
    if (lane == 0) {
        run.x = atomicAdd(counts.entries, run.y);
        node_entries[node] = run;
    }
    barrier();
    uint at = run.x, due = 0, done = 0;
    for (uint window = range[0] / 32; window <= range[1] / 32; window += WORDS) {
        uint words = min(WORDS, range[1] / 32 - window + 1);
        for (uint w = lane; w < words; w += SIZE) bits[w] = 0;
        barrier();
        entry = head;
        for (uint k = 0; k < count; k++) {
            uint word = entry / 32 - window;
            if (word < words) atomicOr(bits[word], 1u << entry % 32);
            entry = next_entries[entry];
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
        due += own;
        for (uint w = begin; w < end; w++) {
            for (uint left = bits[w]; left != 0; left &= left - 1) {
                uint e = 32 * (window + w) + findLSB(left);
                sorted[place++] = uvec2(e / 16, floatBitsToUint(entry_weights[e]));
                done++;
            }
        }
        barrier();
    }
    // If these numbers differ, the driver ended a loop early.
    if (at != run.x + run.y || done != due) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
