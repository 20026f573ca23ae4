#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"
#include "shared/node_motion.glsl"

// Elastic stage of a step: trial displacements, at which elastic/element_forces linearises in the next Newton
// iteration. They say where the solution x (changes of velocity) of the last solve would take each node by the end of
// the step of h seconds, seen from the node's frame (rigid coordinate frame of rotation R) at the start, so that the
// links (relative placements of two frames) still apply. For a free node with displacement d and velocity v the trial
// displacement is d + h R^T (v + x). For a node attached to a dynamic core (rigid body inside a soft body, whose motion
// the solver finds) it is h R^T u + (Q - I) r, with the core's new velocity u and angular velocity w, Q the rotation by
// h R^T w, and r the node's rest position. The kernel also keeps the residual b - A x of the last solve. Steps of one
// Newton iteration do not run this kernel. One invocation runs for each node. The f64 reference implementation is
// oracle::newton.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 6) const uint RIGIDS = 0;  // rigid unknowns: dynamic cores, and the rigid tool that a user moves

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, frames);
READ_ONLY(uvec4, node_info);      // frame of each node in z; NODE_* of shared/node_motion.glsl in w
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, velocity);
READ_ONLY(vec4, solution);         // x, change of velocity, m/s; zero where the motion is prescribed
READ_ONLY(vec4, rhs);
READ_ONLY(vec4, operator_product);     // A x
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer TrialDisplacement { vec4 trial_displacement[]; };      // m, frame axes
layout(scalar) writeonly buffer TrialChange { vec4 trial_change[]; };
layout(scalar) writeonly buffer LinearResidual { vec4 linear_residual[]; };    // b - A x

#include "shared/frame.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    uvec4 info = fetch(node_info, i);
    Frame frame = frame_at(info.z);
    vec4 change = fetch(solution, i);
    trial_change[i] = change;
    linear_residual[i] = fetch(rhs, i) - fetch(operator_product, i);
    vec3 d = fetch(displacement, i).xyz, v = fetch(velocity, i).xyz + change.xyz;
    if (RIGIDS > 0 && info.w == NODE_ATTACHED) {
        float x[6] = iterates[solve.current * RIGIDS + frame.core].x;
        v = frame.linear + vec3(x[0], x[1], x[2]);
        vec3 spin = frame.angular + vec3(x[3], x[4], x[5]);
        d = turned(turn_by(params.dt * rotate_back(frame.rotation, spin)), fetch(node_rest, i).xyz);
    }
    trial_displacement[i] = vec4(d + params.dt * rotate_back(frame.rotation, v), 0.0);
}
