#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull: which proxies may touch. Boxes first, then the distance of the hulls: a pair stays when it is at most reach, both
// inflations together. One invocation a pair of proxies; results do not depend on the order in which pairs are appended.
// Oracle: oracle::proximity::pairs (parry3d's distance).

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PROXY_PAIRS = 1;

layout(scalar, binding = 0) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 1) readonly buffer Bounds { ProxyBounds bounds[]; };
layout(binding = 2) uniform usamplerBuffer proxy_pairs;     // proxy of a, proxy of b
layout(binding = 3) uniform samplerBuffer hull;
layout(scalar, binding = 4) writeonly buffer ActivePairs { uint active_pairs[]; };
layout(scalar, binding = 5) writeonly buffer Reach { vec2 reach_of[]; };   // reach, distance of the hulls
layout(scalar, binding = 6) writeonly buffer Directions { vec4 directions[]; };    // none yet
layout(scalar, binding = 7) buffer Args { uint args[]; };

#include "shared/gjk.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= PROXY_PAIRS) return;
    directions[2 * i] = directions[2 * i + 1] = vec4(0.0);
    uvec2 which = texelFetch(proxy_pairs, int(i)).xy;
    ProxyBounds a_bounds = bounds[which.x];
    ProxyBounds b_bounds = bounds[which.y];
    float reach = a_bounds.inflation + b_bounds.inflation;
    if (any(greaterThan(a_bounds.low - b_bounds.high, vec3(reach)))) return;
    if (any(greaterThan(b_bounds.low - a_bounds.high, vec3(reach)))) return;
    Proxy a = proxies[which.x];
    Proxy b = proxies[which.y];
    float distance = hull_distance(a.hull_first, a.hull_count, b.hull_first, b.hull_count, reach);
    if (distance > reach) return;
    reach_of[i] = vec2(reach, distance);
    active_pairs[atomicAdd(args[3 * ARGS_DIRECTION], 1)] = i;
}
