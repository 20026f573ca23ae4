#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"

// Draw: outward normals of the skin as it is now, n = sum (b - a) x (c - a) over the triangles around a vertex (each counts with
// its area), of length one; zero where they have no area. One invocation a skin vertex of all bodies.
// Oracle: the same sum in f64 over Simulation::skin_positions.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint VERTICES = 0;

READ_ONLY(uvec4, triangles);
layout(scalar) readonly buffer FanFirst { uint fan_first[]; };
layout(scalar) readonly buffer Fans { uint fans[]; };
READ_ONLY(vec4, positions);
layout(scalar) writeonly buffer Normals { vec4 normals[]; };       // w: 0

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
