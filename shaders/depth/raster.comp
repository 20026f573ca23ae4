#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/tile.glsl"

// Depth, compute path: triangles of active proxies that face the other body, into their region's tile. Two passes of the
// same kernel: least height, then (NAMES) the least triangle among those of that height; so that it needs no 64-bit
// atomics and does not depend on order. One invocation a triangle. Oracle: oracle::proximity::raster.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool NAMES = false;
layout(constant_id = 2) const uint TILE = 128;

layout(scalar, binding = 0) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 1) readonly buffer ActiveList { ActiveProxy active_list[]; };
layout(scalar, binding = 2) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 3) readonly buffer ProxyTriangles { uint proxy_triangles[]; };
layout(scalar, binding = 4) readonly buffer Regions { Region regions[]; };
layout(binding = 5) uniform usamplerBuffer triangles;       // three skin vertices
layout(binding = 6) uniform samplerBuffer skin;
layout(scalar, binding = 7) buffer Heights { uint heights[]; };     // TILE x TILE keys a side, cleared to all ones
layout(scalar, binding = 8) buffer Names { uint names[]; };         // triangles, cleared to NONE

#include "shared/active.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counts.triangles) return;
    ActiveProxy entry = active_list[active_with(OF_TRIANGLES, i, counts.active_proxies)];
    uint triangle = proxy_triangles[proxies[entry.proxy].triangle_first + i - entry.triangle_first];
    Region region = regions[entry.side / 2];
    if (region.width == 0) return;
    bool side_b = (entry.side & 1) != 0;
    uvec3 corners = texelFetch(triangles, int(triangle)).xyz;
    precise vec3 p = to_tile(region, texelFetch(skin, int(corners.x)).xyz);
    precise vec3 q = to_tile(region, texelFetch(skin, int(corners.y)).xyz);
    precise vec3 r = to_tile(region, texelFetch(skin, int(corners.z)).xyz);
    precise float area = edge(p.xy, q.xy, r.xy);
    if (side_b ? area >= 0.0 : area <= 0.0) return;
    vec2 last = vec2(region.width, region.height) - 1.0;
    // Texel centres lie at k + 1/2.
    vec2 least = max(ceil(min(min(p.xy, q.xy), r.xy) - 0.5), vec2(0.0));
    vec2 greatest = min(floor(max(max(p.xy, q.xy), r.xy) - 0.5), last);
    uint base = entry.side * TILE * TILE;
    for (float y = least.y; y <= greatest.y; y += 1.0) {
        for (float x = least.x; x <= greatest.x; x += 1.0) {
            vec2 centre = vec2(x, y) + 0.5;
            precise float a = edge(q.xy, r.xy, centre) / area;
            precise float b = edge(r.xy, p.xy, centre) / area;
            precise float c = edge(p.xy, q.xy, centre) / area;
            if (a < 0.0 || b < 0.0 || c < 0.0) continue;
            precise float height = a * p.z + b * q.z + c * r.z;
            uint key = height_key(height, side_b);
            uint texel = base + uint(y) * TILE + uint(x);
            if (!NAMES) {
                atomicMin(heights[texel], key);
            } else if (heights[texel] == key) {
                atomicMin(names[texel], triangle);
            }
        }
    }
}
