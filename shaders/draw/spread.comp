#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Draw: a number of the nodes at a vertex, max(0, sum w_i n_i) (weights of skin outside its tetrahedron may be negative);
// zero on a rigid body. One invocation a vertex. Oracle: the same sum in f64.

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Points { uint vertices; };

layout(binding = 0) uniform usamplerBuffer skin_nodes;      // as in draw/place
layout(binding = 1) uniform samplerBuffer skin_weights;
layout(scalar, binding = 2) readonly buffer NodeValues { float node_values[]; };
layout(scalar, binding = 3) writeonly buffer Values { float values[]; };

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= vertices) return;
    uvec4 nodes = texelFetch(skin_nodes, int(vertex));
    vec4 weights = texelFetch(skin_weights, int(vertex));
    float sum = 0.0;
    for (uint k = 0; k < 4 && nodes.x != NONE; k++) sum += weights[k] * node_values[nodes[k]];
    values[vertex] = max(0.0, sum);
}
