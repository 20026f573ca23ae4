#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull: active chunks of all slots as one list in the order of slots, a work item each chunk and region, and the indirect
// arguments of everything downstream. What exceeds MOST_ITEMS raises the region overflow flag. One workgroup.
// Oracle: the lists joined by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint SLOTS = 1;
layout(constant_id = 2) const uint MOST_ITEMS = 1;

layout(scalar, binding = 0) readonly buffer Slots { Slot slots[]; };
layout(scalar, binding = 1) readonly buffer SlotChunks { uvec2 slot_chunks[]; };
layout(scalar, binding = 2) coherent buffer SlotCounts { uvec2 slot_counts[]; };    // becomes running totals
layout(scalar, binding = 3) writeonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar, binding = 4) writeonly buffer Items { uvec2 items[]; };              // active chunk, region
layout(scalar, binding = 5) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 6) writeonly buffer Args { uint args[]; };

shared uvec2 totals[SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint run = (SLOTS + SIZE - 1) / SIZE;
    uint begin = min(lane * run, SLOTS), end = min(begin + run, SLOTS);
    uvec2 own = uvec2(0);
    for (uint s = begin; s < end; s++) own += slot_counts[s];
    totals[lane] = own;
    barrier();
    uvec2 at = uvec2(0), all = uvec2(0);
    for (uint k = 0; k < SIZE; k++) {
        if (k < lane) at += totals[k];
        all += totals[k];
    }
    for (uint s = begin; s < end; s++) {
        uvec2 count = slot_counts[s];
        slot_counts[s] = at;
        at += count;
    }
    memoryBarrierBuffer();
    barrier();
    for (uint e = lane; e < min(all.x, MOST_ITEMS); e += SIZE) {
        // The last slot whose total does not exceed e.
        uint low = 0, high = SLOTS;
        while (high - low > 1) {
            uint middle = (low + high) / 2;
            if (slot_counts[middle].x <= e) low = middle;
            else high = middle;
        }
        uvec2 found = slot_chunks[slots[low].chunk_first + e - slot_counts[low].x];
        uint first_item = slot_counts[low].y + (found.y >> PAIR_REGIONS);
        uint mask = found.y & ((1u << PAIR_REGIONS) - 1u);
        uint item = first_item;
        for (uint r = 0; r < PAIR_REGIONS; r++) {
            if ((mask & (1u << r)) == 0) continue;
            if (item < MOST_ITEMS) items[item] = uvec2(e, slots[low].pair * PAIR_REGIONS + r);
            else mask &= ~(1u << r);
            item += 1;
        }
        active_chunks[e] = ActiveChunk(found.x, low, 2 * slots[low].pair + slots[low].side, mask, first_item);
    }
    if (lane != 0) return;
    uint listed = min(all.y, MOST_ITEMS), used = min(all.x, MOST_ITEMS);
    if (all.y > MOST_ITEMS) atomicOr(counts.flags, FLAG_REGION_OVERFLOW);
    counts.chunks = used;
    counts.items = listed;
    args[3 * ARGS_ACTIVE] = used;
    args[3 * ARGS_ITEMS] = listed;
    args[3 * ARGS_COMPACT] = used > 0 ? 1 : 0;
    args[3 * ARGS_DRAW] = 6 * CHUNK_TRIANGLES;
    args[3 * ARGS_DRAW + 1] = listed;
    args[3 * ARGS_DRAW + 2] = 0;
    args[3 * ARGS_DRAW + 3] = 0;
}
