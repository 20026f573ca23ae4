#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Solve: force and torque by which each holder acts on its soft body. A holder is a support (a condition on the motion of
// nodes) or a core of prescribed motion (a rigid part of the body that the solver does not move). The force that holds a
// node is the residual of its equation in the directions that it does not have, divided by the step; where several
// supports hold a node, each has the share that its own directions have of it. The torque is about the origin of the
// step's positions, with the nodes where they are at the start of the step. One workgroup runs for each holder, which
// sums over its nodes. The f64 reference is oracle::step. A frame is a rigid coordinate frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, frames);
READ_ONLY(uvec4, node_info);                // z: index of the node's frame
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
layout(scalar) readonly buffer SupportedNodes { Supported supported[]; };      // with the impulses of solve/gather
layout(scalar) readonly buffer Holders { uvec2 holders[]; };       // of each: its nodes, a range of held_nodes
layout(scalar) readonly buffer HeldNodes { uint held_nodes[]; };
READ_ONLY(vec4, held_shares);               // of each: rows of the matrix that maps a node's impulse to the holder's share
layout(scalar) writeonly buffer Reactions { float reactions[]; };  // of each holder: force (N) and torque (N m)

#include "shared/frame.glsl"
#include "shared/sum.glsl"

void main() {
    uvec2 range = holders[gl_WorkGroupID.x];
    vec4 force = vec4(0.0), torque = vec4(0.0);
    for (uint k = range.x + gl_LocalInvocationID.x; k < range.x + range.y; k += SIZE) {
        uint node = held_nodes[k];
        Frame frame = frame_at(fetch(node_info, node).z);
        vec3 at = frame.centre + rotate(frame.rotation, fetch(node_rest, node).xyz + fetch(displacement, node).xyz);
        vec3 impulse = supported[node].impulse;
        vec3 own = vec3(dot(fetch(held_shares, 3 * k).xyz, impulse), dot(fetch(held_shares, 3 * k + 1).xyz, impulse),
            dot(fetch(held_shares, 3 * k + 2).xyz, impulse)) / params.dt;
        force.xyz += own;
        torque.xyz += cross(at, own);
    }
    force = workgroup_sum(force);
    torque = workgroup_sum(torque);
    if (gl_LocalInvocationID.x != 0) return;
    for (uint k = 0; k < 3; k++) {
        reactions[6 * gl_WorkGroupID.x + k] = force[k];
        reactions[6 * gl_WorkGroupID.x + 3 + k] = torque[k];
    }
}
