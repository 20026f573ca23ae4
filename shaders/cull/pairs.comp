#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull: which proxies may touch. Boxes first, then the distance of the hulls: a pair stays when it is at most reach, both
// inflations together and a seam. One invocation a pair of proxies; results do not depend on the order in which pairs are appended.
// Oracle: oracle::proximity::pairs (parry3d's distance).

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PROXY_PAIRS = 1;

layout(scalar, binding = 0) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 1) uniform samplerBuffer bounds;           // two texels a proxy: least corner and inflation, greatest corner and radius
layout(binding = 2) uniform usamplerBuffer proxy_pairs;     // proxy of a, proxy of b
layout(binding = 3) uniform samplerBuffer hull;
layout(scalar, binding = 4) writeonly buffer ActivePairs { uint active_pairs[]; };
layout(scalar, binding = 5) writeonly buffer Reach { vec2 reach_of[]; };   // reach, distance of the hulls
layout(scalar, binding = 6) writeonly buffer Directions { vec4 directions[]; };    // none yet
layout(scalar, binding = 7) buffer Args { uint args[]; };

#include "shared/gjk.glsl"

// Of the smaller radius.
const float SEAM = 0.02;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= PROXY_PAIRS) return;
    directions[2 * i] = vec4(0.0);
    uvec2 which = texelFetch(proxy_pairs, int(i)).xy;
    vec4 a_low = texelFetch(bounds, int(2 * which.x)), b_low = texelFetch(bounds, int(2 * which.y));
    // Hulls are drawn in where bodies are cut into them: a little of their size covers that.
    vec4 a_top = texelFetch(bounds, int(2 * which.x + 1)), b_top = texelFetch(bounds, int(2 * which.y + 1));
    vec3 a_high = a_top.xyz, b_high = b_top.xyz;
    float reach = a_low.w + b_low.w + SEAM * min(a_top.w, b_top.w);
    if (any(greaterThan(a_low.xyz - b_high, vec3(reach))) || any(greaterThan(b_low.xyz - a_high, vec3(reach)))) return;
    Proxy a = proxies[which.x];
    Proxy b = proxies[which.y];
    float distance = hull_distance(a.hull_first, a.hull_count, b.hull_first, b.hull_count, reach);
    if (distance > reach) return;
    reach_of[i] = vec2(reach, distance);
    active_pairs[atomicAdd(args[3 * ARGS_DIRECTION], 1)] = i;
}
