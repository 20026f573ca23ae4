#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Draw stage (for display, not part of a step): the greatest number in each range of an array of non-negative numbers;
// zero for an empty range; NaN is ignored. One workgroup runs for each range. The test compares with the greatest
// number, found on the CPU.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar) readonly buffer Ranges { uvec2 ranges[]; };  // first index of each range, and one after its last index
layout(scalar) readonly buffer Values { float values[]; };
layout(scalar) writeonly buffer Most { float most[]; };

shared float greatest[SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uvec2 range = ranges[gl_WorkGroupID.x];
    float own = 0.0;
    for (uint k = range.x + lane; k < range.y; k += SIZE) {
        float value = values[k];
        if (value > own) own = value;
    }
    greatest[lane] = own;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) greatest[lane] = max(greatest[lane], greatest[lane + width]);
    }
    if (lane == 0) most[gl_WorkGroupID.x] = greatest[0];
}
