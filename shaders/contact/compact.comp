#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Contact: colliding candidates into a dense list that keeps their order, whatever the device; more than CAPACITY raise
// the contact overflow flag. One workgroup; each lane takes a contiguous run. Oracle: the list filtered by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint CAPACITY = 1;
layout(constant_id = 2) const uint NODES = 0;
layout(constant_id = 3) const uint TETRAHEDRA = 0;

layout(binding = 0) uniform samplerBuffer candidate_hits;
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) writeonly buffer ContactSource { uint contact_source[]; };
layout(scalar, binding = 3) writeonly buffer Args { uint args[]; };

shared uint totals[SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint run = (counts.vertices + SIZE - 1) / SIZE;
    uint begin = min(lane * run, counts.vertices), end = min(begin + run, counts.vertices);
    uint found = 0;
    for (uint i = begin; i < end; i++) found += texelFetch(candidate_hits, int(i)).x > 0.0 ? 1 : 0;
    totals[lane] = found;
    barrier();
    uint at = 0, all = 0;
    for (uint k = 0; k < SIZE; k++) {
        if (k < lane) at += totals[k];
        all += totals[k];
    }
    for (uint i = begin; i < end; i++) {
        if (texelFetch(candidate_hits, int(i)).x <= 0.0) continue;
        if (at < CAPACITY) contact_source[at] = i;
        at += 1;
    }
    if (lane != 0) return;
    uint contacts = min(all, CAPACITY);
    counts.contacts = contacts;
    if (all > CAPACITY) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    args[3 * ARGS_CONTACTS] = groups_of(contacts);
    args[3 * ARGS_CONTACT_NODES] = contacts > 0 ? groups_of(NODES) : 0;
    args[3 * ARGS_ENTRIES] = groups_of(16 * contacts);
    args[3 * ARGS_APPLY] = groups_of(TETRAHEDRA + contacts);
}
