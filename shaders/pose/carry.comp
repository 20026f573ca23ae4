#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"

// Pose: velocities of the nodes that moving frames carry. On a dynamic core, at the start: v = u + w x arm,
// and the first guess of its change, P x with the arms of this step (A x is taken of it). On a driven frame,
// over the whole step, v = (x1 - x0) / h
// = v_centre + R0 (R0^T R1 - I) r / h. The right-hand side, h f - (h^2 + h beta) K v, then holds what these known velocities
// give to the unknown ones, and contacts feel them. One invocation a carried node. Oracle: oracle::step, whose bound nodes
// take any velocity.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint CARRIED_NODES = 0;
layout(constant_id = 6) const uint RIGIDS = 0;

layout(scalar) readonly buffer Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer CarriedNodes { uint carried_nodes[]; };
READ_ONLY(uvec4, node_info);       // frame in z
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer Velocity { vec4 velocity[]; };
layout(scalar) writeonly buffer Solution { vec4 solution[]; };     // of dynamic cores only

#include "shared/core.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= CARRIED_NODES) return;
    uint node = carried_nodes[i];
    Frame frame = frames[fetch(node_info, node).z];
    // R0^T R1 is the inverse of dR = R1^T R0.
    vec4 on = vec4(-frame.turn.xyz, frame.turn.w);
    vec3 r = fetch(node_rest, node).xyz;
    if (frame.core != NONE) {
        vec3 arm = rotate(frame.rotation, r);
        velocity[node] = vec4(frame.linear + cross(frame.angular, arm), 0.0);
        solution[node] = vec4(carry(iterates[solve.current * RIGIDS + frame.core].x, arm), 0.0);
        return;
    }
    velocity[node] = vec4(frame.linear + rotate(frame.rotation, turned(on, r)) / params.dt, 0.0);
}
