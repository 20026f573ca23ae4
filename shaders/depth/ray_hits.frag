#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Depth, narrow phase, graphics path: tests a triangle against the skin vertices of the opposing side in one cell of a
// contact patch's spatial hash that it may cover (shared/ray_hit.glsl). One invocation a cell. Oracle: cross.comp.

layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const uint MOST_HITS = 1;

layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer ContactPatches { ContactPatch contact_patches[]; };
READ_ONLY(uvec4, buckets);         // heads of the hash's lists, four a texel; see shared/spatial_hash.glsl
READ_ONLY(uvec4, hash_entries);
layout(scalar) readonly buffer EntryCells { uvec2 entry_cells[]; };      // cell of each vertex in the hash
layout(scalar) buffer EntryHits { uint entry_hits[]; };                      // first hit of each vertex in the hash
layout(scalar) writeonly buffer Hits { uvec4 hits[]; };  // triangle, next hit, bits of the depth, 2 * item + (1: front)

layout(location = 0) flat in vec3 corners[3];                 // along the patch's axes, m
layout(location = 3) flat in uvec3 triangle_at;               // the triangle, 2 * patch + its side, its work item

#include "shared/spatial_hash.glsl"
#include "shared/ray_hit.glsl"

void main() {
    // Helper invocations, which fill up blocks of pixels, write nothing by the specification. Testing
    // gl_HelperInvocation, to spare them the work, crashes Mesa's llvmpipe 22.3.
    ivec2 cell = ivec2(gl_FragCoord.xy);
    uint ended = hit_cells(cell, cell, triangle_at.y ^ 1, corners, triangle_at.y & 1, triangle_at.x, triangle_at.z);
    if (ended != 1) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
