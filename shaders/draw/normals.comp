#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Draw: outward normals of the skin as it is now, n = sum (b - a) x (c - a) over the triangles around a vertex (each counts with
// its area), of length one; zero where they have no area. One invocation a skin vertex of all bodies.
// Oracle: the same sum in f64 over Simulation::skin_positions.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint VERTICES = 0;

layout(binding = 0) uniform usamplerBuffer triangles;
layout(scalar, binding = 1) readonly buffer FanFirst { uint fan_first[]; };
layout(scalar, binding = 2) readonly buffer Fans { uint fans[]; };
layout(binding = 3) uniform samplerBuffer positions;
layout(scalar, binding = 4) writeonly buffer Normals { vec4 normals[]; };       // w: 0

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= VERTICES) return;
    vec3 sum = vec3(0.0);
    for (uint k = fan_first[vertex]; k < fan_first[vertex + 1]; k++) {
        uvec4 corners = texelFetch(triangles, int(fans[k]));
        vec3 a = texelFetch(positions, int(corners.x)).xyz;
        sum += cross(texelFetch(positions, int(corners.y)).xyz - a, texelFetch(positions, int(corners.z)).xyz - a);
    }
    float size = length(sum);
    normals[vertex] = vec4(size > 0.0 ? sum / size : vec3(0.0), 0.0);
}
