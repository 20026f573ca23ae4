#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Pose stage, at the end of a step: computes sums from which the host (CPU side) fits a floating frame to its nodes. A
// frame is a rigid coordinate frame; a floating frame is that of a soft body without rigid cores. The sums are sum m d,
// sum m r x d, sum m v and sum m (x - centre) x v over the frame's nodes of mass m, with rest position r, displacement
// d, position x and velocity v. Where sum m d and sum m r x d vanish, the frame is the best fit (M. Mueller and others
// 2005, "Meshless Deformations Based on Shape Matching"). One workgroup runs for each frame. The test compares with
// these sums in f64.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Floating { uvec4 floating[]; };      // frame, first node, number of nodes
READ_ONLY(vec4, node_rest);        // w: mass, kg
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, velocity);
layout(scalar) writeonly buffer Fits { Fit fits[]; };

#include "shared/sum.glsl"

void main() {
    uvec4 which = floating[gl_WorkGroupID.x];
    Frame frame = frames[which.x];
    // The frame's rotation R1 at the end of the step: R1 = R0 (R1^T R0)^T, with R0 at the start and `turn` = R1^T R0.
    vec4 rotation = compose(frame.rotation, vec4(-frame.turn.xyz, frame.turn.w));
    vec3 shift = vec3(0.0), twist = vec3(0.0), momentum = vec3(0.0), spin = vec3(0.0);
    for (uint i = which.y + gl_LocalInvocationID.x; i < which.y + which.z; i += SIZE) {
        vec4 rest = fetch(node_rest, i);
        vec3 d = fetch(displacement, i).xyz;
        vec3 v = fetch(velocity, i).xyz;
        shift += rest.w * d;
        twist += rest.w * cross(rest.xyz, d);
        momentum += rest.w * v;
        spin += rest.w * cross(rotate(rotation, rest.xyz + d), v);
    }
    shift = workgroup_sum(vec4(shift, 0.0)).xyz;
    twist = workgroup_sum(vec4(twist, 0.0)).xyz;
    momentum = workgroup_sum(vec4(momentum, 0.0)).xyz;
    spin = workgroup_sum(vec4(spin, 0.0)).xyz;
    if (gl_LocalInvocationID.x == 0) fits[gl_WorkGroupID.x] = Fit(shift, twist, momentum, spin);
}
