#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"
#include "shared/node_motion.glsl"
#include "shared/support.glsl"

// Solve: commits the solution x (change of velocity) of the linear system A x = b to the nodes' velocities v and
// displacements d: v += x and d += (dR - I) (r + d) + h R1^T (v - v_centre). A displacement is in the node's frame
// (rigid coordinate frame), whose rotation is R0 at the start and R1 at the end of the step of h seconds; dR = R1^T R0,
// r is the node's rest position and v_centre the velocity of the frame's centre. The second formula moves the node by
// h v in the world, and expresses its new place in the frame at the end. The kernel also keeps the residual b - A x,
// which the next step adds to its b (carried residual), and x minus the last step's solution (the trend). Nodes attached
// to a rigid core (rigid body inside a soft one) keep d = 0. The tool is the rigid body that the haptic device leads.
// One invocation runs for each node. The f64
// reference is oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 6) const uint RIGIDS = 0;     // rigid bodies among the unknowns: cores and the tool
layout(constant_id = 5) const bool SUPPORTS = false;   // whether some nodes are supported (shared/support.glsl)
layout(constant_id = 7) const bool NEWTON = false;     // whether a step has several Newton iterations

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, frames);
READ_ONLY(uvec4, node_info);       // z: index of the node's frame; w: NODE_* of shared/node_motion.glsl
READ_ONLY(vec4, solution);
READ_ONLY(vec4, rhs);
READ_ONLY(vec4, operator_product);            // A x
READ_ONLY(vec4, linear_residual);       // b - A x of the last Newton iteration's solve
READ_ONLY(vec4, node_rest);
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
READ_WRITE(vec4, velocity);
READ_WRITE(vec4, displacement);
READ_WRITE(vec4, trend);         // minus the last step's solution before, x minus that after
layout(scalar) writeonly buffer CarriedResidual { vec4 carried_residual[]; };      // carried residual b - A x
layout(scalar) readonly buffer SupportedNodes { Supported supported[]; };

#include "shared/frame.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    uvec4 info = fetch(node_info, i);
    if (info.w == NODE_KINEMATIC) return;
    vec4 x = fetch(solution, i);
    store(trend, i, fetch(trend, i) + x);
    if (info.w != NODE_FREE) return;
    vec3 v = fetch(velocity, i).xyz + x.xyz;
    vec4 support = vec4(0.0);
    if (SUPPORTS) {
        // What rounding leaves of x along the other directions would add up.
        support = supported[i].left;
        v = along_support(support, v);
    }
    vec4 undone;
    if (NEWTON) undone = fetch(linear_residual, i);
    else undone = fetch(rhs, i) - fetch(operator_product, i);
    carried_residual[i] = undone;
    store(velocity, i, vec4(v, 0.0));
    Frame frame = frame_at(info.z);
    if (RIGIDS > 0 && frame.core != NONE) {
        float twist[6] = iterates[solve.current * RIGIDS + frame.core].x;
        frame.linear += vec3(twist[0], twist[1], twist[2]);
        // R1 = exp(h w1) R0 with the new angular velocity w1, so dR = R1^T R0 is the rotation by -h R0^T w1.
        frame.turn = turn_by(-params.dt * rotate_back(frame.rotation, frame.angular + vec3(twist[3], twist[4], twist[5])));
    }
    vec3 d = fetch(displacement, i).xyz;
    // R1^T = dR R0^T maps world axes to the axes of the frame at the end.
    vec3 step = rotate(frame.turn, rotate_back(frame.rotation, params.dt * (v - frame.linear)));
    d = d + turned(frame.turn, fetch(node_rest, i).xyz + d) + step;
    // The frame of a supported node rests, and the node's displacement is in what the support leaves to it.
    if (SUPPORTS) d = along_support(vec4(rotate_back(frame.rotation, support.xyz), support.w), d);
    store(displacement, i, vec4(d, 0.0));
}
