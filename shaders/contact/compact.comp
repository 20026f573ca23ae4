#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Contact: colliding candidates into a dense list that keeps their order, whatever the device. More than CAPACITY raise the
// contact overflow flag, and the deepest stay. One workgroup; each lane takes a contiguous run.
// Oracle: the list filtered by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint CAPACITY = 1;
layout(constant_id = 3) const uint TETRAHEDRA = 0;

layout(binding = 0) uniform samplerBuffer candidate_hits;       // CHUNK_VERTICES an active chunk
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) writeonly buffer ContactSource { uint contact_source[]; };
layout(scalar, binding = 3) writeonly buffer Args { uint args[]; };

shared uint totals[SIZE];

uint begin, end;

// Candidates deeper than `least` before this lane's run, and in all.
uvec2 count_deeper(float least) {
    uint lane = gl_LocalInvocationID.x;
    uint found = 0;
    for (uint i = begin; i < end; i++) found += texelFetch(candidate_hits, int(i)).x > least ? 1 : 0;
    barrier();
    totals[lane] = found;
    barrier();
    uvec2 sums = uvec2(0);
    for (uint k = 0; k < SIZE; k++) sums += uvec2(k < lane ? totals[k] : 0, totals[k]);
    return sums;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint candidates = counts.chunks * CHUNK_VERTICES;
    uint run = (candidates + SIZE - 1) / SIZE;
    begin = min(lane * run, candidates);
    end = min(begin + run, candidates);
    float least = 0.0;
    uvec2 sums = count_deeper(least);
    if (sums.y > CAPACITY) {
        if (lane == 0) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
        // The least depth beyond which they fit: bits of positive floats are in order.
        uint low = 0, high = 0x7f7fffffu;
        while (high - low > 1) {
            uint middle = (low + high) / 2;
            if (count_deeper(uintBitsToFloat(middle)).y > CAPACITY) low = middle;
            else high = middle;
        }
        least = uintBitsToFloat(high);
        sums = count_deeper(least);
    }
    uint at = sums.x;
    for (uint i = begin; i < end; i++) {
        if (texelFetch(candidate_hits, int(i)).x > least) contact_source[at++] = i;
    }
    if (lane != 0) return;
    uint contacts = sums.y;
    counts.contacts = contacts;
    args[3 * ARGS_CONTACTS] = groups_of(contacts);
    args[3 * ARGS_ENTRIES] = groups_of(16 * contacts);
    args[3 * ARGS_APPLY] = groups_of(TETRAHEDRA + contacts);
}
