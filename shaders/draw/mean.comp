#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Draw stage (for display, not part of a step): a number of the tetrahedra (energy density, a stress) at each node, which
// is the mean over the node's tetrahedra weighted by volume; zero at a node without tetrahedra. One invocation runs for
// each node. The test compares with this mean in f64.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 2) const uint TEXELS = 1;          // texels of each tetrahedron in `numbers`
layout(constant_id = 3) const uint TEXEL = 0;           // the one of them that the number is in
layout(constant_id = 4) const uint COMPONENT = 0;       // its component

// Index in `node_tetrahedra` of each node's first tetrahedron, and after the last node the length of `node_tetrahedra`.
layout(scalar) readonly buffer NodeFirst { uint node_first[]; };
layout(scalar) readonly buffer NodeTetrahedra { uint node_tetrahedra[]; };  // tetrahedra around each node
READ_ONLY(vec4, numbers);
READ_ONLY(vec4, densities);            // y: volume, m^3; one for each tetrahedron
layout(scalar) writeonly buffer NodeValues { float node_values[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    float sum = 0.0, volume = 0.0;
    for (uint k = node_first[i]; k < node_first[i + 1]; k++) {
        uint t = node_tetrahedra[k];
        float own = fetch(densities, t).y;
        sum += fetch(numbers, TEXELS * t + TEXEL)[COMPONENT] * own;
        volume += own;
    }
    node_values[i] = volume > 0.0 ? sum / volume : 0.0;
}
