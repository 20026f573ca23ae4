#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Draw: how far a vertex is from where the frames of its nodes alone would carry it, |sum w_i R_i d_i| (m); zero on a rigid
// body. One invocation a vertex. Oracle: the same sum in f64.

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Points { uint vertices; };

layout(scalar, binding = 0) readonly buffer Frames { Frame frames[]; };     // rotations as they are now
layout(binding = 1) uniform usamplerBuffer skin_nodes;      // as in draw/place
layout(binding = 2) uniform samplerBuffer skin_weights;
layout(binding = 3) uniform samplerBuffer displacement;
layout(binding = 4) uniform usamplerBuffer node_info;       // frame in z
layout(scalar, binding = 5) writeonly buffer Values { float values[]; };

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= vertices) return;
    uvec4 nodes = texelFetch(skin_nodes, int(vertex));
    vec4 weights = texelFetch(skin_weights, int(vertex));
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < 4 && nodes.x != NONE; k++) {
        uint frame = texelFetch(node_info, int(nodes[k])).z;
        sum += weights[k] * rotate(frames[frame].rotation, texelFetch(displacement, int(nodes[k])).xyz);
    }
    values[vertex] = length(sum);
}
