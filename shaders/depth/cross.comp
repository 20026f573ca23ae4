#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Depth, compute path: triangles of an active chunk, front and back, over the squares of their region that they cover; in
// each, the vertices of the other side whose rays they cross. One workgroup an active chunk and region.
// Oracle: oracle::contact::crossings.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const uint MOST_HITS = 1;

layout(scalar, binding = 0) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 1) readonly buffer Items { uvec2 items[]; };
layout(scalar, binding = 2) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar, binding = 3) readonly buffer Chunks { Chunk chunks[]; };
layout(scalar, binding = 4) readonly buffer ChunkTriangles { uint chunk_triangles[]; };
layout(scalar, binding = 5) readonly buffer Regions { Region regions[]; };
layout(binding = 6) uniform usamplerBuffer triangles;       // three skin vertices
layout(binding = 7) uniform samplerBuffer skin;
layout(binding = 8) uniform usamplerBuffer buckets;         // four a texel
layout(binding = 9) uniform usamplerBuffer bins;
layout(scalar, binding = 10) readonly buffer BinSides { uint bin_sides[]; };
layout(scalar, binding = 11) buffer BinHits { uint bin_hits[]; };
layout(scalar, binding = 12) writeonly buffer Hits { uvec4 hits[]; };       // triangle, next, bits of the depth, front

#include "shared/bins.glsl"
#include "shared/covered.glsl"
#include "shared/crossing.glsl"

void main() {
    uvec2 item = items[gl_WorkGroupID.x];
    ActiveChunk entry = active_chunks[item.x];
    Chunk chunk = chunks[entry.chunk];
    Region region = regions[item.y];
    uint side = entry.side & 1, other = 1 - side;
    for (uint t = gl_LocalInvocationID.x; t < chunk.triangle_count; t += SIZE) {
        uint triangle = chunk_triangles[chunk.triangle_first + t];
        vec3 corners[3];
        ivec2 first, last;
        if (!covered_squares(region, side, triangle, corners, first, last)) continue;
        for (int y = first.y; y <= last.y; y++) {
            for (int x = first.x; x <= last.x; x++) {
                cross_square(ivec2(x, y), 2 * item.y + other, corners, side, triangle);
            }
        }
    }
}
