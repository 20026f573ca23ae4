#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Draw stage (for display, not part of a step): interpolates a number from nodes to a skin vertex (vertex of a body's
// surface mesh), max(0, sum w_i n_i), with weight w_i and number n_i of each of the vertex's four nodes; zero on a
// rigid body. A weight may be negative where the vertex lies outside its tetrahedron. One invocation runs for each
// vertex. The test compares with this sum in f64.

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Points { uint vertices; };

READ_ONLY(uvec4, skin_nodes);      // four nodes of each vertex; NONE first: vertex of a rigid body
READ_ONLY(vec4, skin_weights);
layout(scalar) readonly buffer NodeValues { float node_values[]; };
layout(scalar) writeonly buffer Values { float values[]; };

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= vertices) return;
    uvec4 nodes = fetch(skin_nodes, vertex);
    vec4 weights = fetch(skin_weights, vertex);
    float sum = 0.0;
    for (uint k = 0; k < 4 && nodes.x != NONE; k++) sum += weights[k] * node_values[nodes[k]];
    values[vertex] = max(0.0, sum);
}
