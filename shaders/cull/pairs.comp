#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull: which proxies may touch. Boxes first, then the distance of the hulls: a pair stays when it is at most
// reach = both inflations + depth_limit (so that a triangle that a deep vertex meets is there as well). One invocation a
// pair of proxies; results do not depend on the order in which pairs are appended.
// Oracle: oracle::proximity::pairs (parry3d's distance).

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PROXY_PAIRS = 1;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Pairs { Pair pairs[]; };
layout(scalar, binding = 2) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 3) readonly buffer Bounds { ProxyBounds bounds[]; };
layout(binding = 4) uniform usamplerBuffer proxy_pairs;     // proxy of a, proxy of b or NONE, pair
layout(binding = 5) uniform samplerBuffer hull;
layout(scalar, binding = 6) buffer ProxyActive { uint proxy_active[]; };    // cleared; two words a pair of proxies' bodies
layout(scalar, binding = 7) writeonly buffer ActivePairs { uint active_pairs[]; };
layout(scalar, binding = 8) writeonly buffer Reach { float reach_of[]; };
layout(scalar, binding = 9) buffer Args { uint args[]; };

#include "shared/gjk.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= PROXY_PAIRS) return;
    uvec4 which = texelFetch(proxy_pairs, int(i));
    Pair pair = pairs[which.z];
    Proxy a = proxies[which.x];
    ProxyBounds a_bounds = bounds[which.x];
    if (pair.is_plane != 0) {
        vec3 lowest = support(a.hull_first, a.hull_count, -pair.plane.xyz);
        if (dot(lowest, pair.plane.xyz) - pair.plane.w <= a_bounds.inflation) {
            atomicOr(proxy_active[which.w], 1);
        }
        return;
    }
    Proxy b = proxies[which.y];
    ProxyBounds b_bounds = bounds[which.y];
    float reach = a_bounds.inflation + b_bounds.inflation + params.depth_limit;
    if (any(greaterThan(a_bounds.low - b_bounds.high, vec3(reach)))) return;
    if (any(greaterThan(b_bounds.low - a_bounds.high, vec3(reach)))) return;
    if (hull_distance(a.hull_first, a.hull_count, b.hull_first, b.hull_count, reach) > reach) return;
    // which.w is the slot of a's proxy; b's slots of the pair follow a's.
    atomicOr(proxy_active[which.w], 1);
    uint b_slot = which.w - (which.x - pair.first_proxy[0]) + pair.proxy_count[0] + (which.y - pair.first_proxy[1]);
    atomicOr(proxy_active[b_slot], 1);
    reach_of[i] = reach;
    active_pairs[atomicAdd(args[3 * ARGS_DIRECTION], 1)] = i;
}
