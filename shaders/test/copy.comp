#version 460
// Test kernel for the test harness of vk-tests, not part of the step: target[i] = scale * source[i] + offsets[i].x for
// i < count. One invocation runs for each element, and writes only that element. `misdeed` makes the kernel commit a
// fault that the harness must detect: 1 writes past the end of target, 2 changes the first element of marked, 3 leaves
// the last element unwritten; 0: no fault.
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint misdeed = 0;
layout(constant_id = 2) const float scale = 1.0;

struct CopyParams {
    vec3 unused;
    uint count;
    mat3 also_unused;
};

layout(scalar) readonly buffer Params { CopyParams params; };
layout(scalar) readonly buffer Source { float source[]; };
READ_ONLY(vec4, offsets);
layout(scalar) buffer Marked { uint marked[]; };
layout(scalar) writeonly buffer Target { float target[]; };
layout(push_constant, scalar) uniform Push { uint first; };

void main() {
    uint i = first + gl_GlobalInvocationID.x;
    if (i >= params.count) return;
    if (misdeed == 2 && i == 0) marked[0] += 1;
    if (misdeed == 1 && i == 0) target[params.count] = 1.0;
    if (misdeed == 3 && i + 1 == params.count) return;
    target[i] = scale * source[i] + fetch(offsets, i).x;
}
