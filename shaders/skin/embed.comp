#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Skin: positions of the skin of active proxies, x = sum w_i (c_i + R_i (r_i + d_i)) (or c + R r on a rigid body), and of the
// neighbours that their normals need. One invocation an embedded vertex; a vertex that several proxies list is written by
// each of them with the same value. w is the step's number: a position that is not of this step is not looked at.
// Oracle: oracle::proximity::embed.

layout(local_size_x_id = 0) in;
layout(constant_id = 2) const bool SPANS = false;       // whether a skin vertex may have nodes in several frames

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Frames { Frame frames[]; };
layout(scalar, binding = 2) readonly buffer CountsIn { Counts counts; };
layout(scalar, binding = 3) readonly buffer ActiveList { ActiveProxy active_list[]; };
layout(scalar, binding = 4) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar, binding = 5) readonly buffer ProxyEmbeds { uint proxy_embeds[]; };
layout(binding = 6) uniform usamplerBuffer skin_nodes;      // four nodes; NONE first: rigid
layout(binding = 7) uniform samplerBuffer skin_weights;     // four weights; of a rigid skin: position in the frame
layout(binding = 8) uniform samplerBuffer node_rest;
layout(binding = 9) uniform samplerBuffer displacement;
layout(binding = 10) uniform usamplerBuffer node_info;       // frame in z
layout(scalar, binding = 11) writeonly buffer Skin { vec4 skin[]; };

#include "shared/active.glsl"

vec3 node_position(uint node) { return texelFetch(node_rest, int(node)).xyz + texelFetch(displacement, int(node)).xyz; }

vec3 world(uint node) {
    Frame frame = frames[texelFetch(node_info, int(node)).z];
    return frame.centre + rotate(frame.rotation, node_position(node));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counts.embeds) return;
    ActiveProxy entry = active_list[active_with(OF_EMBEDS, i, counts.active_proxies)];
    uint vertex = proxy_embeds[proxies[entry.proxy].embed_first + i - entry.embed_first];
    uvec4 nodes = texelFetch(skin_nodes, int(vertex));
    vec4 weights = texelFetch(skin_weights, int(vertex));
    float stamp = float(1 + params.step % 0xfffff);
    if (SPANS && nodes.x != NONE) {
        vec3 x = weights.x * world(nodes.x) + weights.y * world(nodes.y) + weights.z * world(nodes.z)
            + weights.w * world(nodes.w);
        skin[vertex] = vec4(x, stamp);
        return;
    }
    Frame frame = frames[proxies[entry.proxy].frame];
    vec3 local = weights.xyz;
    if (nodes.x != NONE) {
        local = weights.x * node_position(nodes.x) + weights.y * node_position(nodes.y)
            + weights.z * node_position(nodes.z) + weights.w * node_position(nodes.w);
    }
    skin[vertex] = vec4(frame.centre + rotate(frame.rotation, local), stamp);
}
