#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull stage (broad phase) of a step: finds which pairs of collision proxies (convex hulls around parts of the bodies'
// surface meshes, the skins) may touch. First their boxes are tested, then the distance of the hulls: a pair stays if
// the distance is at most `reach`, the sum of both inflations (how far skin may lie outside a hull) and a seam (the gap
// between hulls of one body, SEAM). The pairs of a workgroup are far apart in the list of pairs, so that pairs that may
// touch, which are often adjacent there, are divided among workgroups. Pairs whose boxes meet are listed first, so that
// no lane is idle while others compute the distance of hulls. No result depends on the order in which pairs are
// appended. A workgroup tests SHARE pairs. The f64 reference implementation is oracle::proximity::pairs (distance by
// the library parry3d).

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint PROXY_PAIRS = 1;
layout(constant_id = 2) const uint SHARE = 64;      // pairs that a workgroup tests

layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
READ_ONLY(vec4, bounds);           // two texels per proxy: least corner and inflation, greatest corner and radius
READ_ONLY(uvec4, proxy_pairs);     // first proxy, second proxy
READ_ONLY(vec4, hull);
layout(scalar) writeonly buffer ActivePairs { uint active_pairs[]; };
layout(scalar) writeonly buffer Reach { vec2 reach_of[]; };   // reach and distance of the hulls of each pair, m
layout(scalar) writeonly buffer Directions { vec4 directions[]; };    // cleared for cull/direction
layout(scalar) buffer Args { uint args[]; };

#include "shared/gjk.glsl"

// Width of the seam, in radii of the smaller hull.
const float SEAM = 0.02;

shared uint listed[SHARE];
shared float listed_reach[SHARE];
shared uint listed_count;

void main() {
    uint lane = gl_LocalInvocationID.x;
    if (lane == 0) listed_count = 0;
    barrier();
    for (uint k = lane; k < SHARE; k += SIZE) {
        uint i = gl_WorkGroupID.x + k * gl_NumWorkGroups.x;
        if (i >= PROXY_PAIRS) break;
        directions[2 * i] = vec4(0.0);
        uvec2 which = fetch(proxy_pairs, i).xy;
        vec4 a_low = fetch(bounds, 2 * which.x), b_low = fetch(bounds, 2 * which.y);
        // If a body has several hulls, these have been shrunk; the seam covers the gaps between them.
        vec4 a_top = fetch(bounds, 2 * which.x + 1), b_top = fetch(bounds, 2 * which.y + 1);
        float reach = a_low.w + b_low.w + SEAM * min(a_top.w, b_top.w);
        vec3 apart = max(a_low.xyz - b_top.xyz, b_low.xyz - a_top.xyz);
        if (any(greaterThan(apart, vec3(reach)))) continue;
        uint at = atomicAdd(listed_count, 1);
        listed[at] = i;
        listed_reach[at] = reach;
    }
    barrier();
    for (uint k = lane; k < listed_count; k += SIZE) {
        uint i = listed[k];
        uvec2 which = fetch(proxy_pairs, i).xy;
        Proxy a = proxies[which.x];
        Proxy b = proxies[which.y];
        float reach = listed_reach[k];
        float distance = hull_distance(a.hull_first, a.hull_count, b.hull_first, b.hull_count, reach);
        if (distance > reach) continue;
        reach_of[i] = vec2(reach, distance);
        active_pairs[atomicAdd(args[3 * ARGS_DIRECTION], 1)] = i;
    }
}
