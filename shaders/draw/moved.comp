#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Draw, beside the step: distance of a vertex from where the frames of its nodes alone would put it, |sum w_i R_i d_i|
// (m), with weight w_i, frame rotation R_i and displacement d_i of its four nodes; zero on a rigid body. One invocation
// a vertex. Oracle: its test takes the same sum in f64.

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Points { uint vertices; };

layout(scalar) readonly buffer Frames { Frame frames[]; };     // placements as they are now
READ_ONLY(uvec4, skin_nodes);      // four nodes; NONE first: rigid
READ_ONLY(vec4, skin_weights);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_info);       // frame in z
layout(scalar) writeonly buffer Values { float values[]; };

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= vertices) return;
    uvec4 nodes = fetch(skin_nodes, vertex);
    vec4 weights = fetch(skin_weights, vertex);
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < 4 && nodes.x != NONE; k++) {
        uint frame = fetch(node_info, nodes[k]).z;
        sum += weights[k] * rotate(frames[frame].rotation, fetch(displacement, nodes[k]).xyz);
    }
    values[vertex] = length(sum);
}
