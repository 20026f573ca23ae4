#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"

// Cull: which chunks of an active slot may touch, and in which regions. A vertex x = R (sum w_i (r_i + d_i)) of a chunk lies in
// its rest box moved by the middle of its nodes' displacements and grown by (sum |w|) times half their spread; that box must
// overlap the box of an opposing slot along the tangents, and not lie wholly in front of it. Chunks keep their order within
// the slot. One workgroup an active slot. Oracle: oracle::regions::chunk_box.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool SPANS = false;       // whether a chunk may have nodes in other frames

layout(scalar, binding = 0) readonly buffer Pairs { Pair pairs[]; };
layout(scalar, binding = 1) readonly buffer Slots { Slot slots[]; };
layout(scalar, binding = 2) readonly buffer ActiveSlots { uint active_slots[]; };
layout(scalar, binding = 3) readonly buffer Frames { Frame frames[]; };
layout(scalar, binding = 4) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 5) readonly buffer Chunks { Chunk chunks[]; };
layout(scalar, binding = 6) readonly buffer ChunkNodes { uvec2 chunk_nodes[]; };      // node, link from the proxy's frame to its own
layout(binding = 7) uniform samplerBuffer displacement;
layout(binding = 8) uniform samplerBuffer node_rest;
layout(scalar, binding = 9) readonly buffer Links { Link links[]; };
layout(scalar, binding = 10) readonly buffer Regions { Region regions[]; };
layout(scalar, binding = 11) readonly buffer Boxes { vec3 boxes[]; };
layout(scalar, binding = 12) readonly buffer SlotRegions { uint slot_regions[]; };
layout(scalar, binding = 13) writeonly buffer SlotChunks { uvec2 slot_chunks[]; };    // chunk; regions, and items before it
layout(scalar, binding = 14) writeonly buffer SlotCounts { uvec2 slot_counts[]; };    // chunks, items

shared uint masks[SIZE];

// Rest box in the proxy's frame, as the nodes have moved.
void chunk_box(Chunk chunk, out vec3 centre, out vec3 half_extent) {
    centre = chunk.centre;
    half_extent = chunk.half_extent;
    if (chunk.node_count == 0) return;
    vec3 least = vec3(3.0e38), greatest = vec3(-3.0e38);
    for (uint k = 0; k < chunk.node_count; k++) {
        uvec2 node = chunk_nodes[chunk.node_first + k];
        vec3 d = texelFetch(displacement, int(node.x)).xyz;
        if (SPANS && node.y != 0) d = across(links[node.y], texelFetch(node_rest, int(node.x)).xyz, d);
        least = min(least, d);
        greatest = max(greatest, d);
    }
    centre += 0.5 * (least + greatest);
    // A thousandth more covers rounding.
    half_extent += 1.001 * chunk.weight_bound * 0.5 * (greatest - least);
}

uint regions_of(Chunk chunk, Frame frame, Pair pair, uint pair_index, uint side, uint bits) {
    vec3 centre, half_extent;
    chunk_box(chunk, centre, half_extent);
    centre = frame.centre + rotate(frame.rotation, centre);
    mat3 turned = mat3(rotate(frame.rotation, vec3(half_extent.x, 0.0, 0.0)),
        rotate(frame.rotation, vec3(0.0, half_extent.y, 0.0)), rotate(frame.rotation, vec3(0.0, 0.0, half_extent.z)));
    uint found = 0;
    for (uint r = 0; r < PAIR_REGIONS; r++) {
        if ((bits & (1u << r)) == 0) continue;
        Region region = regions[pair_index * PAIR_REGIONS + r];
        mat3 axes = mat3(region.tangent, region.bitangent, region.normal);
        vec3 middle = centre * axes;
        vec3 reach = abs(turned[0] * axes) + abs(turned[1] * axes) + abs(turned[2] * axes) + 1.0e-6;
        vec3 least = middle - reach, greatest = middle + reach;
        if (pair.is_plane != 0) {
            if (greatest.z >= -pair.plane.w) found |= 1u;
            continue;
        }
        uint begin = pair.first_slot + (side == 0 ? pair.proxy_count[0] : 0), count = pair.proxy_count[1 - side];
        for (uint slot = begin; slot < begin + count; slot++) {
            if ((slot_regions[slot] & (1u << r)) == 0) continue;
            vec3 low = boxes[2 * (slot * PAIR_REGIONS + r)], high = boxes[2 * (slot * PAIR_REGIONS + r) + 1];
            bool beside = any(greaterThan(least.xy, high.xy)) || any(lessThan(greatest.xy, low.xy));
            bool before = side == 0 ? greatest.z < low.z : least.z > high.z;
            if (!beside && !before) {
                found |= 1u << r;
                break;
            }
        }
    }
    return found;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint slot_index = active_slots[gl_WorkGroupID.x];
    Slot slot = slots[slot_index];
    Pair pair = pairs[slot.pair];
    Proxy proxy = proxies[slot.proxy];
    Frame frame = frames[proxy.frame];
    uint bits = slot_regions[slot_index];
    uint listed = 0, items = 0;
    for (uint first = 0; first < proxy.chunk_count; first += SIZE) {
        uint chunk = proxy.chunk_first + first + lane;
        uint mask = first + lane < proxy.chunk_count ? regions_of(chunks[chunk], frame, pair, slot.pair, slot.side, bits) : 0;
        masks[lane] = mask;
        barrier();
        uint before = 0, items_before = 0, found = 0, items_found = 0;
        for (uint k = 0; k < SIZE; k++) {
            uint one = masks[k] != 0 ? 1 : 0, each = bitCount(masks[k]);
            if (k < lane) {
                before += one;
                items_before += each;
            }
            found += one;
            items_found += each;
        }
        if (mask != 0) {
            slot_chunks[slot.chunk_first + listed + before] = uvec2(chunk, mask | (items + items_before) << PAIR_REGIONS);
        }
        listed += found;
        items += items_found;
        barrier();
    }
    if (lane == 0) slot_counts[slot_index] = uvec2(listed, items);
}
