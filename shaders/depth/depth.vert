#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/tile.glsl"

// Depth, graphics path: the depth passes of the paper. The target holds a column of tiles, two a region (side a, side b);
// vertices are pulled from the active list. One invocation a corner of an active triangle. Same answer as depth/raster.

layout(constant_id = 2) const uint TILE = 128;
layout(constant_id = 3) const uint TILES = 2;

layout(scalar, binding = 0) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 1) readonly buffer ActiveList { ActiveProxy active_list[]; };
layout(scalar, binding = 2) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 3) readonly buffer ProxyTriangles { uint proxy_triangles[]; };
layout(scalar, binding = 4) readonly buffer Regions { Region regions[]; };
layout(binding = 5) uniform usamplerBuffer triangles;
layout(binding = 6) uniform samplerBuffer skin;

#include "shared/active.glsl"

layout(location = 0) flat out uint triangle_name;
layout(location = 1) out vec2 tile_position;
layout(location = 2) flat out vec2 tile_size;

void main() {
    uint i = gl_VertexIndex / 3;
    ActiveProxy entry = active_list[active_with(OF_TRIANGLES, i, counts.active_proxies)];
    uint triangle = proxy_triangles[proxies[entry.proxy].triangle_first + i - entry.triangle_first];
    Region region = regions[entry.side / 2];
    bool side_b = (entry.side & 1) != 0;
    uvec3 corners = texelFetch(triangles, int(triangle)).xyz;
    vec3 corner[3] = vec3[](to_tile(region, texelFetch(skin, int(corners.x)).xyz),
        to_tile(region, texelFetch(skin, int(corners.y)).xyz), to_tile(region, texelFetch(skin, int(corners.z)).xyz));
    vec3 x = corner[gl_VertexIndex % 3];
    float area = edge(corner[0].xy, corner[1].xy, corner[2].xy);
    triangle_name = triangle;
    tile_position = x.xy;
    tile_size = vec2(region.width, region.height);
    bool faces_other = region.width != 0 && (side_b ? area < 0.0 : area > 0.0);
    float depth = (x.z - region.height_low) / (region.height_high - region.height_low);
    vec2 target = vec2(0.0, float(entry.side * TILE)) + x.xy;
    vec2 clip = target / vec2(float(TILE), float(TILE * TILES)) * 2.0 - 1.0;
    // A triangle turned away collapses to a point outside.
    gl_Position = faces_other ? vec4(clip, side_b ? depth : 1.0 - depth, 1.0) : vec4(2.0, 2.0, 0.5, 1.0);
}
