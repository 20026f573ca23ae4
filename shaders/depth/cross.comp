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
layout(scalar, binding = 12) writeonly buffer Hits { uvec4 hits[]; };       // triangle, next, bits of the depth, item and front
layout(binding = 13) uniform usamplerBuffer fields;

#include "shared/bins.glsl"
#include "shared/crossing.glsl"
#include "shared/field.glsl"

// Whether some square that a triangle covers holds chunks of the other side as far back as it reaches.
bool reaches(Region region, uint region_index, uint side, vec2 least, vec2 greatest, float height) {
    uvec4 range = squares(region, least, greatest);
    uint field = field_at(region_index, 1 - side), key = height_key(height);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            uint at = field + y * FIELD + x;
            uint other = texelFetch(fields, int(at / 4))[at % 4];
            if (side == 0 ? key >= other : key <= other) return true;
        }
    }
    return false;
}

void main() {
    uvec2 item = items[gl_WorkGroupID.x];
    ActiveChunk entry = active_chunks[item.x];
    Chunk chunk = chunks[entry.chunk];
    Region region = regions[item.y];
    uint side = entry.side & 1, other = 1 - side;
    for (uint t = gl_LocalInvocationID.x; t < chunk.triangle_count; t += SIZE) {
        uint triangle = chunk_triangles[chunk.triangle_first + t];
        uvec3 vertices = texelFetch(triangles, int(triangle)).xyz;
        vec3 corners[3] = vec3[](along(region, texelFetch(skin, int(vertices.x)).xyz),
            along(region, texelFetch(skin, int(vertices.y)).xyz), along(region, texelFetch(skin, int(vertices.z)).xyz));
        vec2 least = max(min(min(corners[0].xy, corners[1].xy), corners[2].xy), region.low);
        vec2 greatest = min(max(max(corners[0].xy, corners[1].xy), corners[2].xy), region.high);
        if (any(greaterThan(least, greatest))) continue;
        float height = side == 0 ? max(max(corners[0].z, corners[1].z), corners[2].z)
                                 : min(min(corners[0].z, corners[1].z), corners[2].z);
        if (!reaches(region, item.y, side, least, greatest, height)) continue;
        ivec2 first = cell_of(region, other, least), last = cell_of(region, other, greatest);
        for (int y = first.y; y <= last.y; y++) {
            for (int x = first.x; x <= last.x; x++) {
                cross_square(ivec2(x, y), 2 * item.y + other, corners, side, triangle, gl_WorkGroupID.x);
            }
        }
    }
}
