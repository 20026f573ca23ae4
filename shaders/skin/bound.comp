#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"

// Skin: how far a proxy's skin may have left its hull: margin + (sum |w|) max |d| over the nodes that move it, d in the
// proxy's frame, and the box of its hull. One workgroup a proxy. Oracle: oracle::proximity::bounds.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool SPANS = false;       // whether a proxy may have nodes in other frames

layout(scalar, binding = 0) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 1) uniform samplerBuffer hull;
layout(scalar, binding = 2) readonly buffer ProxyNodes { uvec2 proxy_nodes[]; };      // node, link from the proxy's frame to its own
layout(binding = 3) uniform samplerBuffer displacement;
layout(binding = 4) uniform samplerBuffer node_rest;
layout(scalar, binding = 5) readonly buffer Links { Link links[]; };
layout(scalar, binding = 6) writeonly buffer Bounds { ProxyBounds bounds[]; };

shared vec3 low[SIZE];
shared vec3 high[SIZE];
shared float reach2[SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    Proxy proxy = proxies[gl_WorkGroupID.x];
    vec3 least = vec3(3.0e38), greatest = vec3(-3.0e38);
    for (uint i = lane; i < proxy.hull_count; i += SIZE) {
        vec3 x = texelFetch(hull, int(proxy.hull_first + i)).xyz;
        least = min(least, x);
        greatest = max(greatest, x);
    }
    float largest = 0.0;
    for (uint i = lane; i < proxy.node_count; i += SIZE) {
        uvec2 node = proxy_nodes[proxy.node_first + i];
        vec3 d = texelFetch(displacement, int(node.x)).xyz;
        if (SPANS && node.y != 0) d = across(links[node.y], texelFetch(node_rest, int(node.x)).xyz, d);
        largest = max(largest, dot(d, d));
    }
    low[lane] = least;
    high[lane] = greatest;
    reach2[lane] = largest;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) {
            low[lane] = min(low[lane], low[lane + width]);
            high[lane] = max(high[lane], high[lane + width]);
            reach2[lane] = max(reach2[lane], reach2[lane + width]);
        }
    }
    if (lane == 0) {
        // A thousandth more than the bound covers its own rounding.
        float inflation = 1.001 * (proxy.margin + proxy.weight_bound * sqrt(reach2[0])) + 1.0e-6;
        bounds[gl_WorkGroupID.x] = ProxyBounds(low[0], inflation, high[0], 0.5 * length(high[0] - low[0]));
    }
}
