#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/link.glsl"
#include "shared/held.glsl"

// Elastic: where the last solve would take each node by the end of the step, as seen from its frame at the start (so that
// links hold): d + h R^T (v + x); of a node that a dynamic core carries, h R^T u + (Q - I) r, Q the turn by h R^T w with the
// core's new twist. There elastic/rotate linearises again. A step that is linearised once has none of this. One
// invocation a node. Oracle: oracle::newton.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 6) const uint RIGIDS = 0;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer Frames { Frame frames[]; };
layout(binding = 2) uniform usamplerBuffer node_info;
layout(binding = 3) uniform samplerBuffer node_rest;
layout(binding = 4) uniform samplerBuffer displacement;
layout(binding = 5) uniform samplerBuffer velocity;
layout(binding = 6) uniform samplerBuffer solution;         // zero where held
layout(scalar, binding = 7) readonly buffer SolveIn { Solve solve; };
layout(scalar, binding = 8) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar, binding = 9) writeonly buffer TrialDisplacement { vec4 trial_displacement[]; };
layout(scalar, binding = 10) writeonly buffer TrialChange { vec4 trial_change[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    uvec4 info = texelFetch(node_info, int(i));
    Frame frame = frames[info.z];
    vec4 change = texelFetch(solution, int(i));
    trial_change[i] = change;
    vec3 d = texelFetch(displacement, int(i)).xyz, v = texelFetch(velocity, int(i)).xyz + change.xyz;
    if (RIGIDS > 0 && info.w == CARRIED) {
        float x[6] = iterates[solve.current * RIGIDS + frame.core].x;
        v = frame.linear + vec3(x[0], x[1], x[2]);
        vec3 spin = frame.angular + vec3(x[3], x[4], x[5]);
        d = turned(turn_by(params.dt * rotate_back(frame.rotation, spin)), texelFetch(node_rest, int(i)).xyz);
    }
    trial_displacement[i] = vec4(d + params.dt * rotate_back(frame.rotation, v), 0.0);
}
