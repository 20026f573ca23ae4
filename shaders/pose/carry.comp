#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"

// Pose stage of a step: velocities of the nodes of soft bodies that are attached to rigid cores (rigid bodies inside
// soft ones). A core is kinematic if its motion is prescribed, dynamic if the solver finds its motion; its frame is its
// rigid coordinate frame. One invocation runs for each attached node. The f64 reference implementation is oracle::step.
//
// On a dynamic core a node gets the velocity at the start of the step, v = u + w x arm, with the core's velocity u and
// angular velocity w, and the vector `arm` from the core's centre to the node. The node's part of the warm start's two
// vectors follows from the core's last solution and trend with this step's arms, so that the solver can multiply its
// operator with them. On a kinematic core a node gets its mean velocity over the whole step, from its position x0 to x1:
// v = (x1 - x0) / h = v_centre + R0 (R0^T R1 - I) r / h, with the step h, the frame's rotations R0 at the start and R1
// at the end, the velocity v_centre of the frame's centre, and the node's rest position r. The right-hand side of the
// elastic stage then contains the effect of these known velocities on the unknown ones; contacts use the known
// velocities too.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint ATTACHED_NODES = 0;
layout(constant_id = 6) const uint RIGIDS = 0;  // rigid unknowns: dynamic cores, and the rigid tool that a user moves

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, frames);
layout(scalar) readonly buffer AttachedNodes { uint attached_nodes[]; };
READ_ONLY(uvec4, node_info);       // frame of each node in z
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) readonly buffer RigidTrends { RigidIterate rigid_trends[]; };
layout(scalar) writeonly buffer Velocity { vec4 velocity[]; };
layout(scalar) writeonly buffer Solution { vec4 solution[]; };     // written for nodes of dynamic cores only
layout(scalar) writeonly buffer Trend { vec4 trend[]; };           // likewise

#include "shared/frame.glsl"
#include "shared/core.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= ATTACHED_NODES) return;
    uint node = attached_nodes[i];
    Frame frame = frame_at(fetch(node_info, node).z);
    // R0^T R1 is the inverse of R1^T R0, the frame's `turn`.
    vec4 on = vec4(-frame.turn.xyz, frame.turn.w);
    vec3 r = fetch(node_rest, node).xyz;
    if (frame.core != NONE) {
        vec3 arm = rotate(frame.rotation, r);
        velocity[node] = vec4(frame.linear + cross(frame.angular, arm), 0.0);
        solution[node] = vec4(carry(iterates[solve.current * RIGIDS + frame.core].x, arm), 0.0);
        trend[node] = vec4(carry(rigid_trends[frame.core].x, arm), 0.0);
        return;
    }
    velocity[node] = vec4(frame.linear + rotate(frame.rotation, turned(on, r)) / params.dt, 0.0);
}
