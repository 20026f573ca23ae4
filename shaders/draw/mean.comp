#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Draw stage (for display, not part of a step): energy density at each node, which is the mean over the node's
// tetrahedra weighted by volume; zero at a node without tetrahedra. One invocation runs for each node. The test
// compares with this mean in f64.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;

// Index in `node_tetrahedra` of each node's first tetrahedron, and after the last node the length of `node_tetrahedra`.
layout(scalar) readonly buffer NodeFirst { uint node_first[]; };
layout(scalar) readonly buffer NodeTetrahedra { uint node_tetrahedra[]; };  // tetrahedra around each node
READ_ONLY(vec4, densities);            // x: energy density, J/m^3; y: volume, m^3; one for each tetrahedron
layout(scalar) writeonly buffer NodeValues { float node_values[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    float sum = 0.0, volume = 0.0;
    for (uint k = node_first[i]; k < node_first[i + 1]; k++) {
        vec2 own = fetch(densities, node_tetrahedra[k]).xy;
        sum += own.x * own.y;
        volume += own.y;
    }
    node_values[i] = volume > 0.0 ? sum / volume : 0.0;
}
