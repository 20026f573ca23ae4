#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rounds.glsl"

// Depth stage (narrow phase) of a step, as a fragment shader: tests a triangle against the skin vertices of the other
// body in one cell of a contact patch's spatial hash that the triangle may cover (shared/ray_hit.glsl). A skin is the
// surface mesh of a body; a contact patch is a column of space in which two bodies may touch; a work item is a chunk
// (group of skin vertices) in one patch. One invocation runs for each cell. The reference is ray_hits.comp.

layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const uint MOST_HITS = 1;

layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer ContactPatches { ContactPatch contact_patches[]; };
READ_ONLY(uvec4, buckets);         // heads of the hash's lists, four per texel; see shared/spatial_hash.glsl
READ_ONLY(uvec4, hash_entries);
READ_ONLY(uvec4, entry_cells);      // cell of each vertex in the hash, two per texel
layout(scalar) buffer EntryHits { uint entry_hits[]; };                      // first hit of each vertex in the hash
layout(scalar) writeonly buffer Hits { uvec4 hits[]; };  // triangle, next hit, depth bits, 2 * work item + (1: front)

layout(location = 0) flat in vec3 corners[3];                 // along the patch's axes, m
layout(location = 3) flat in uvec3 triangle_at;              // triangle, 2 * patch + (1: triangle of body b), work item

#include "shared/spatial_hash.glsl"
#include "shared/ray_hit.glsl"

void main() {
    // Helper invocations, which complete blocks of 2 x 2 pixels, write nothing, as the specification demands. A test of
    // gl_HelperInvocation, to skip the work of helper invocations, crashes Mesa's llvmpipe 22.3.
    ivec2 cell = ivec2(gl_FragCoord.xy);
    uint ended = hit_cells(cell, cell, triangle_at.y ^ 1, corners, triangle_at.y & 1, triangle_at.x, triangle_at.z);
    if (ended != 1) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
