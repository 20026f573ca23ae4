#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/tile.glsl"

// Contact: the depth of every skin vertex of the active proxies. The texel under the vertex (or, at a rim, a neighbouring
// one) names an opposing triangle, the walk finds the one its ray along n meets, and depth = n.(s1 - s2) is exact for that
// triangle. A half-space needs no texel: depth = offset - N.x. Only vertices that face the other body take part; the area
// is the rest area projected along n, half of it where both bodies gather. One invocation a vertex.
// Oracle: oracle::contact::ray_depths.

layout(local_size_x_id = 0) in;
layout(constant_id = 2) const uint TILE = 128;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) buffer CountsInOut { Counts counts; };
layout(scalar, binding = 2) readonly buffer ActiveList { ActiveProxy active_list[]; };
layout(scalar, binding = 3) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 4) readonly buffer ProxyVertices { uint proxy_vertices[]; };
layout(scalar, binding = 5) readonly buffer Pairs { Pair pairs[]; };
layout(scalar, binding = 6) readonly buffer Regions { Region regions[]; };
layout(scalar, binding = 7) readonly buffer Names { uint names[]; };
layout(binding = 8) uniform usamplerBuffer triangles;           // three skin vertices
layout(binding = 9) uniform usamplerBuffer neighbours;          // across the edges from corner k to k + 1
layout(binding = 10) uniform samplerBuffer skin;
layout(scalar, binding = 11) readonly buffer FanFirst { uint fan_first[]; };     // triangles around a vertex: running totals
layout(scalar, binding = 12) readonly buffer Fans { uint fans[]; };
layout(scalar, binding = 13) readonly buffer Areas { float areas[]; };          // rest, m^2
layout(scalar, binding = 14) writeonly buffer CandidateHits { vec4 candidate_hits[]; };     // depth (0: none), barycentric, area
layout(scalar, binding = 15) writeonly buffer CandidateWhat { uvec4 candidate_what[]; };    // vertex, side, triangle

#include "shared/active.glsl"
#include "shared/walk.glsl"

const int NEIGHBOURS = 9;
const ivec2 AROUND[NEIGHBOURS] = ivec2[](ivec2(0, 0), ivec2(-1, 0), ivec2(1, 0), ivec2(0, -1), ivec2(0, 1),
    ivec2(-1, -1), ivec2(1, -1), ivec2(-1, 1), ivec2(1, 1));

vec3 outward_normal(uint vertex) {
    vec3 sum = vec3(0.0);
    for (uint k = fan_first[vertex]; k < fan_first[vertex + 1]; k++) {
        uvec3 corners = texelFetch(triangles, int(fans[k])).xyz;
        vec3 p = texelFetch(skin, int(corners.x)).xyz;
        sum += cross(texelFetch(skin, int(corners.y)).xyz - p, texelFetch(skin, int(corners.z)).xyz - p);
    }
    float length2 = dot(sum, sum);
    return length2 > 0.0 ? sum * inversesqrt(length2) : vec3(0.0);
}

// Walks from the texel's triangle, then from those of the texels around it, until one finds the ray's triangle.
Hit find(Region region, uint opposing, vec3 x, float stamp) {
    ivec2 texel = ivec2(floor(to_tile(region, x).xy));
    Hit first = Hit(NONE, vec3(0.0), vec3(0.0), 0.0, false);
    uint tried = NONE;
    for (int k = 0; k < NEIGHBOURS; k++) {
        ivec2 at = texel + AROUND[k];
        if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(region.width, region.height)))) continue;
        uint start = names[opposing * TILE * TILE + uint(at.y) * TILE + uint(at.x)];
        if (start == NONE || start == tried) continue;
        tried = start;
        Hit hit = walk(region, (opposing & 1) != 0, start, x, stamp);
        if (!hit.lost) return hit;
        if (!first.lost) first = hit;
    }
    return first;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counts.vertices) return;
    ActiveProxy entry = active_list[active_with(OF_VERTICES, i, counts.active_proxies)];
    uint vertex = proxy_vertices[proxies[entry.proxy].vertex_first + i - entry.vertex_first];
    Pair pair = pairs[entry.side / 2];
    Region region = regions[entry.side / 2];
    bool side_b = (entry.side & 1) != 0;
    vec4 x = texelFetch(skin, int(vertex));
    candidate_hits[i] = vec4(0.0);
    candidate_what[i] = uvec4(vertex, entry.side, NONE, 0);
    float depth = 0.0;
    Hit hit = Hit(NONE, vec3(0.0), vec3(0.0), 0.0, false);
    float half_weight = 1.0;
    if (pair.is_plane != 0) {
        depth = pair.plane.w - dot(pair.plane.xyz, x.xyz);
    } else if (region.width != 0) {
        half_weight = 0.5;
        hit = find(region, entry.side ^ 1, x.xyz, x.w);
        float towards = side_b ? 1.0 : -1.0;
        if (hit.triangle != NONE) depth = towards * dot(region.normal, hit.point);
        else if (hit.lost && towards * hit.guess > region.texel) depth = -1.0;
    }
    if (depth == 0.0 || (depth < 0.0 && hit.triangle != NONE) || (depth < 0.0 && pair.is_plane != 0)) return;
    float facing = dot(outward_normal(vertex), region.normal) * (side_b ? -1.0 : 1.0);
    if (facing <= 0.0) return;
    if (depth < 0.0) {
        // It lies behind the opposing skin, but no triangle of the patch is on its ray.
        atomicOr(counts.flags, FLAG_NOT_HEIGHT_FIELD);
        return;
    }
    if (depth > params.depth_limit) atomicOr(counts.flags, FLAG_DEPTH_LIMIT);
    float area = half_weight * facing * areas[vertex];
    if (area <= 0.0) return;
    candidate_hits[i] = vec4(depth, hit.barycentric.yz, area);
    candidate_what[i] = uvec4(vertex, entry.side, hit.triangle, 0);
}
