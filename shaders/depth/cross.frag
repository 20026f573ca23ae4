#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Depth, graphics path: a triangle in one square that it may cover, against the vertices of the other side there. One
// invocation a square. Oracle: oracle::proximity, and cross.comp to the last bit.

layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const uint MOST_HITS = 1;

layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer Regions { Region regions[]; };
READ_ONLY(uvec4, buckets);         // four a texel
READ_ONLY(uvec4, bins);
layout(scalar) readonly buffer BinSquares { uvec2 bin_squares[]; };
layout(scalar) buffer BinHits { uint bin_hits[]; };
layout(scalar) writeonly buffer Hits { uvec4 hits[]; };       // triangle, next, bits of the depth, item and front

layout(location = 0) flat in vec3 corners[3];
layout(location = 3) flat in uvec3 triangle_at;

#include "shared/bins.glsl"
#include "shared/crossing.glsl"

void main() {
    // Invocations that only fill up blocks of pixels write nothing, by the specification. Asking gl_HelperInvocation, to
    // spare them the lists, crashes Mesa's llvmpipe 22.3.
    ivec2 cell = ivec2(gl_FragCoord.xy);
    uint ended = cross_squares(cell, cell, triangle_at.y ^ 1, corners, triangle_at.y & 1, triangle_at.x, triangle_at.z);
    if (ended != 1) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
