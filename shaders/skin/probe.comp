#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Skin: copies the displacements of the nodes that move the probes, which are skin vertices whose path the scene asks
// for. Each displacement is in its node's frame (rigid coordinate frame). The host sums the displacements with their
// weights and places the probes in the world, in f64. Nodes of a rigid skin are NONE, and their displacements zero. One
// invocation runs for each node of a probe. vk-tests/stage/skin.rs compares the copies with `displacement` exactly.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PROBE_NODES = 0;

layout(scalar) readonly buffer ProbeNodes { uint probe_nodes[]; };
READ_ONLY(vec4, displacement);
layout(scalar) writeonly buffer Probes { vec4 probes[]; };

const uint NONE = 0xffffffffu;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= PROBE_NODES) return;
    uint node = probe_nodes[i];
    probes[i] = node == NONE ? vec4(0.0) : vec4(fetch(displacement, node).xyz, 0.0);
}
