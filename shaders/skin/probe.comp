#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Skin: the displacement sum w_i d_i of the probed skin vertices, frame axes; the host adds it to the rest position in f64.
// One invocation a probe. Oracle: oracle::proximity::embed, in its frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PROBES = 0;

layout(binding = 0) uniform usamplerBuffer probe_nodes;
layout(binding = 1) uniform samplerBuffer probe_weights;
layout(binding = 2) uniform samplerBuffer displacement;
layout(scalar, binding = 3) writeonly buffer Probes { vec4 probes[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= PROBES) return;
    uvec4 nodes = texelFetch(probe_nodes, int(i));
    vec4 weights = texelFetch(probe_weights, int(i));
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < 4; k++) sum += weights[k] * texelFetch(displacement, int(nodes[k])).xyz;
    probes[i] = vec4(sum, 0.0);
}
