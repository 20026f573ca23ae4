#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/field.glsl"

// Cull: of the chunks of an active slot, those that may lie beyond what the other side's chunks reach in some square of their
// region, in their order. One workgroup an active slot. Oracle: every chunk against every opposing chunk, by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar, binding = 0) readonly buffer Pairs { Pair pairs[]; };
layout(scalar, binding = 1) readonly buffer Slots { Slot slots[]; };
layout(scalar, binding = 2) readonly buffer ActiveSlots { uint active_slots[]; };
layout(scalar, binding = 3) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 4) readonly buffer Regions { Region regions[]; };
layout(scalar, binding = 5) readonly buffer Slabs { Slab slabs[]; };
layout(scalar, binding = 6) readonly buffer Fields { uint fields[]; };
layout(scalar, binding = 7) buffer SlotChunks { uvec2 slot_chunks[]; };     // regions; becomes chunk, and regions with items before
layout(scalar, binding = 8) writeonly buffer SlotCounts { uvec2 slot_counts[]; };    // chunks, items

shared uint masks[SIZE];

bool reaches(uint region_index, uint side, Slab slab) {
    Region region = regions[region_index];
    uvec4 range = squares(region, slab.low, slab.high);
    uint field = field_at(region_index, 1 - side);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            uint key = height_key(slab_height(region, slab, side, uvec2(x, y)));
            uint other = fields[field + y * FIELD + x];
            if (side == 0 ? key >= other : key <= other) return true;
        }
    }
    return false;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint slot_index = active_slots[gl_WorkGroupID.x];
    Slot slot = slots[slot_index];
    bool is_plane = pairs[slot.pair].is_plane != 0;
    Proxy proxy = proxies[slot.proxy];
    uint listed = 0, items = 0;
    for (uint first = 0; first < proxy.chunk_count; first += SIZE) {
        uint k = first + lane;
        uint mask = k < proxy.chunk_count ? slot_chunks[slot.chunk_first + k].x : 0;
        for (uint r = 0; r < PAIR_REGIONS; r++) {
            if ((mask & (1u << r)) == 0 || is_plane) continue;
            Slab slab = slabs[(slot.chunk_first + k) * PAIR_REGIONS + r];
            if (!reaches(slot.pair * PAIR_REGIONS + r, slot.side, slab)) mask &= ~(1u << r);
        }
        masks[lane] = mask;
        barrier();
        uint before = 0, items_before = 0, found = 0, items_found = 0;
        for (uint l = 0; l < SIZE; l++) {
            uint one = masks[l] != 0 ? 1 : 0, each = bitCount(masks[l]);
            if (l < lane) {
                before += one;
                items_before += each;
            }
            found += one;
            items_found += each;
        }
        // The list never runs ahead of what is read: all lanes have read theirs.
        if (mask != 0) {
            slot_chunks[slot.chunk_first + listed + before] =
                uvec2(proxy.chunk_first + k, mask | (items + items_before) << PAIR_REGIONS);
        }
        listed += found;
        items += items_found;
        barrier();
    }
    if (lane == 0) slot_counts[slot_index] = uvec2(listed, items);
}
