#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Elastic stage: the force of a pressure p on each loaded triangle of a skin (surface mesh), -p (b - a) x (c - a) / 2,
// with its corners a, b, c where they are at the start of the step, counter-clockwise seen from outside. One invocation
// runs for each triangle. The f64 reference is oracle::loads. A frame is a rigid coordinate frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TRIANGLES = 0;

READ_ONLY(uvec4, frames);
READ_ONLY(uvec4, node_info);                // z: index of the node's frame
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, load_sources);              // w: pressure, Pa
layout(scalar) readonly buffer LoadedTriangles { uint loaded_triangles[]; };   // source of each triangle's pressure
READ_ONLY(uvec4, corner_nodes);             // three per triangle: the nodes that a corner follows
READ_ONLY(vec4, corner_weights);            // three per triangle: with which weights
layout(scalar) writeonly buffer TriangleForces { vec4 triangle_forces[]; };    // N

#include "shared/frame.glsl"

vec3 place_of(uint node) {
    Frame frame = frame_at(fetch(node_info, node).z);
    return frame.centre + rotate(frame.rotation, fetch(node_rest, node).xyz + fetch(displacement, node).xyz);
}

vec3 corner(uint k) {
    uvec4 nodes = fetch(corner_nodes, k);
    vec4 weights = fetch(corner_weights, k);
    return weights.x * place_of(nodes.x) + weights.y * place_of(nodes.y) + weights.z * place_of(nodes.z)
        + weights.w * place_of(nodes.w);
}

void main() {
    uint t = gl_GlobalInvocationID.x;
    if (t >= TRIANGLES) return;
    vec3 a = corner(3 * t), b = corner(3 * t + 1), c = corner(3 * t + 2);
    float pressure = fetch(load_sources, loaded_triangles[t]).w;
    triangle_forces[t] = vec4(-0.5 * pressure * cross(b - a, c - a), 0.0);
}
