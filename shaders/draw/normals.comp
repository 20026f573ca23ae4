#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Draw stage (for display, not part of a step): unit outward normals of the skin (the bodies' surface meshes) as it is
// now. They are along the sum of (b - a) x (c - a) over the triangles (a, b, c) around a vertex, which weights each
// triangle by its area; zero where all triangles have no area. One invocation runs for each skin vertex of all bodies.
// The test compares with this sum in f64, computed from Simulation::skin_positions.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint VERTICES = 0;

READ_ONLY(uvec4, triangles);
layout(scalar) readonly buffer FanFirst { uint fan_first[]; };     // first entry of each vertex in `fans`, then the end
layout(scalar) readonly buffer Fans { uint fans[]; };              // triangles around each vertex
READ_ONLY(vec4, positions);
layout(scalar) writeonly buffer Normals { vec4 normals[]; };       // w is 0

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= VERTICES) return;
    vec3 sum = vec3(0.0);
    for (uint k = fan_first[vertex]; k < fan_first[vertex + 1]; k++) {
        uvec4 corners = fetch(triangles, fans[k]);
        vec3 a = fetch(positions, corners.x).xyz;
        sum += cross(fetch(positions, corners.y).xyz - a, fetch(positions, corners.z).xyz - a);
    }
    float size = length(sum);
    normals[vertex] = vec4(size > 0.0 ? sum / size : vec3(0.0), 0.0);
}
