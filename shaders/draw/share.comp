#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Draw: what a patch's volumetric strain theta = sum V tr(E) / V adds to the density of each of its tetrahedra,
// lambda / 2 theta^2 (elastic/dilate). One invocation a patch, which alone writes its tetrahedra.
// Oracle: oracle::elastic::Elements::densities.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PATCHES = 0;

layout(scalar, binding = 0) readonly buffer First { uint first[]; };            // running totals of members
layout(scalar, binding = 1) readonly buffer Members { uint members[]; };
layout(scalar, binding = 2) buffer Densities { vec4 densities[]; };             // as draw/energy left them

void main() {
    uint p = gl_GlobalInvocationID.x;
    if (p >= PATCHES) return;
    float change = 0.0, volume = 0.0;
    for (uint k = first[p]; k < first[p + 1]; k++) {
        vec4 own = densities[members[k]];
        change += own.y * own.z;
        volume += own.y;
    }
    float theta = volume > 0.0 ? change / volume : 0.0;
    for (uint k = first[p]; k < first[p + 1]; k++) densities[members[k]].x += 0.5 * densities[members[k]].w * theta * theta;
}
