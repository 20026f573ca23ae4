#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Draw stage (for display, not part of a step): position x of a skin vertex (vertex of a body's surface mesh) as it is
// now, relative to an origin that the host (CPU side) chose (m). On a soft body x = sum w_i (c_i + R_i (r_i + d_i))
// over the vertex's four nodes, with weight w_i, rest position r_i, displacement d_i, and centre c_i and rotation R_i
// of the node's frame (rigid coordinate frame). On a rigid body x = c + R r, with the vertex's rest position r, and
// centre c and rotation R of the body's frame. One invocation runs for each skin vertex of all bodies. The reference is
// Simulation::skin_positions.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint VERTICES = 0;

layout(scalar) readonly buffer Frames { Frame frames[]; };      // placements of the frames, as they are now
READ_ONLY(uvec4, skin_nodes);      // four nodes of each vertex; NONE first: vertex of a rigid body
READ_ONLY(vec4, skin_weights);     // four weights; of a vertex of a rigid body: its rest position in the frame, m
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_info);       // frame of each node in z
layout(scalar) readonly buffer RigidFrames { uint rigid_frames[]; };   // the body's frame, for vertices of rigid bodies
layout(scalar) writeonly buffer Positions { vec4 positions[]; };       // w is 1

vec3 world(uint frame, vec3 local) { return frames[frame].centre + rotate(frames[frame].rotation, local); }

vec3 node_position(uint node) {
    vec3 local = fetch(node_rest, node).xyz + fetch(displacement, node).xyz;
    return world(fetch(node_info, node).z, local);
}

void main() {
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= VERTICES) return;
    uvec4 nodes = fetch(skin_nodes, vertex);
    vec4 weights = fetch(skin_weights, vertex);
    vec3 x = vec3(0.0);
    if (nodes.x == NONE) {
        x = world(rigid_frames[vertex], weights.xyz);
    } else {
        for (uint k = 0; k < 4; k++) x += weights[k] * node_position(nodes[k]);
    }
    positions[vertex] = vec4(x, 1.0);
}
