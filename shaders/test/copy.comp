#version 460
// The harness's own kernel: target[i] = scale * source[i] + offsets[i].x, for i < count. It stands in no step.
// One invocation per element; each writes its own. `misdeed` makes it do on purpose what the harness must notice:
// 1 writes past the end of target, 2 changes the first marked element, 3 leaves the last element unwritten.
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint misdeed = 0;
layout(constant_id = 2) const float scale = 1.0;

struct CopyParams {
    vec3 unused;
    uint count;
    mat3 also_unused;
};

layout(scalar, set = 0, binding = 0) readonly buffer Params { CopyParams params; };
layout(scalar, set = 0, binding = 1) readonly buffer Source { float source[]; };
layout(set = 0, binding = 2) uniform samplerBuffer offsets;
layout(scalar, set = 0, binding = 3) buffer Marked { uint marked[]; };
layout(scalar, set = 0, binding = 4) writeonly buffer Target { float target[]; };
layout(push_constant, scalar) uniform Push { uint first; };

void main() {
    uint i = first + gl_GlobalInvocationID.x;
    if (i >= params.count) return;
    if (misdeed == 2 && i == 0) marked[0] += 1;
    if (misdeed == 1 && i == 0) target[params.count] = 1.0;
    if (misdeed == 3 && i + 1 == params.count) return;
    target[i] = scale * source[i] + texelFetch(offsets, int(i)).x;
}
