#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Pose stage of a step: places a collision proxy (convex hull around part of a skin, a body's surface mesh) in the
// world. A frame is a rigid coordinate frame, a link the relative placement of two frames. The kernel writes the hull's
// vertices x = c + R r, with their rest positions r, and centre c and rotation R of the proxy's frame; the hull's face
// planes, each with the normal n = R n_rest and the offset offset_rest + n . c; the hull's box; and a bound on how far
// skin lies outside the hull: the sum of this distance at rest (margin) and (sum |w|) max |d|, over embedding weights w
// and displacements d, in the proxy's frame, of the nodes that move the skin. The first invocation clears the step's
// counters and those indirect arguments that the stages cull to contact set. One workgroup runs for each proxy. The f64
// reference implementation is oracle::proximity.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool SPANS = false;       // whether a proxy may have nodes in frames other than its own

layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
READ_ONLY(vec4, hull_rest);          // vertices of all hulls, from their frame's centre, m
READ_ONLY(vec4, face_rest);          // face planes of all hulls: unit normal, offset
READ_ONLY(uvec4, proxy_nodes);       // two per texel: node, link from the proxy's frame to the node's frame
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, links);
layout(scalar) writeonly buffer Hull { vec4 hull[]; };
layout(scalar) writeonly buffer Faces { vec4 faces[]; };    // face planes in the world: unit normal, offset
layout(scalar) writeonly buffer Bounds { ProxyBounds bounds[]; };
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) writeonly buffer Args { uint args[]; };

#include "shared/link.glsl"
#include "shared/moved.glsl"

shared vec3 low[SIZE];
shared vec3 high[SIZE];
shared float reach2[SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    if (gl_GlobalInvocationID.x == 0) {
        counts = Counts(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, counts.contacts, 0);
        for (uint k = 0; k < ARGS_LOOP_ELEMENT_PRODUCT; k++) {
            args[3 * k] = 0;
            args[3 * k + 1] = 1;
            args[3 * k + 2] = 1;
        }
        args[3 * ARGS_DRAW + 1] = 0;
    }
    Proxy proxy = proxies[gl_WorkGroupID.x];
    Frame frame = frames[proxy.frame];
    vec3 least = vec3(3.0e38), greatest = vec3(-3.0e38);
    for (uint i = proxy.hull_first + lane; i < proxy.hull_first + proxy.hull_count; i += SIZE) {
        vec3 x = frame.centre + rotate(frame.rotation, fetch(hull_rest, i).xyz);
        hull[i] = vec4(x, 0.0);
        least = min(least, x);
        greatest = max(greatest, x);
    }
    for (uint f = proxy.face_first + lane; f < proxy.face_first + proxy.face_count; f += SIZE) {
        vec4 rest = fetch(face_rest, f);
        vec3 n = rotate(frame.rotation, rest.xyz);
        faces[f] = vec4(n, rest.w + dot(n, frame.centre));
    }
    float largest = 0.0;
    for (uint i = proxy.node_first / 2 + lane; 2 * i < proxy.node_first + proxy.node_count; i += SIZE) {
        uvec4 two = fetch(proxy_nodes, i);
        vec3 d = moved(two.xy), e = moved(two.zw);
        largest = max(largest, max(dot(d, d), dot(e, e)));
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
        // The factor 1.001 covers the rounding of the bound.
        float inflation = 1.001 * (proxy.margin + proxy.weight_bound * sqrt(reach2[0])) + 1.0e-6;
        bounds[gl_WorkGroupID.x] = ProxyBounds(low[0], inflation, high[0], 0.5 * length(high[0] - low[0]));
    }
}
