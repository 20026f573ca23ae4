#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Draw stage (for display, not part of a step): distance of a skin vertex (vertex of a body's surface mesh) from where
// it would be if its body did not deform, |sum w_i R_i d_i| (m), with weight w_i, displacement d_i, and rotation R_i of
// the frame (rigid coordinate frame) of each of its four nodes; zero on a rigid body. One invocation runs for each
// vertex. The test compares with this sum in f64.

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Points { uint vertices; };

layout(scalar) readonly buffer Frames { Frame frames[]; };     // placements of the frames, as they are now
READ_ONLY(uvec4, skin_nodes);      // four nodes of each vertex; NONE first: vertex of a rigid body
READ_ONLY(vec4, skin_weights);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_info);       // frame of each node in z
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
