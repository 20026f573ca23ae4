#version 460
// Test kernel with barriers, not part of the step: sums[g] is the sum of the components y of the elements of `values`
// from index g * length to (g + 1) * length - 1, with length = `length_of_each`, plus `added`, all with the opposite
// sign if `negated`. One workgroup runs for each sum; its first invocation writes the sum. The order of additions
// depends on the workgroup size.
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool negated = false;
layout(constant_id = 2) const int added = 0;
layout(scalar) uniform Lengths { uint length_of_each; };
READ_ONLY(uvec4, values);
layout(scalar) writeonly buffer Sums { int sums[]; };
shared uint partial[gl_WorkGroupSize.x];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint first = gl_WorkGroupID.x * length_of_each;
    uint own = 0;
    for (uint i = lane; i < length_of_each; i += gl_WorkGroupSize.x) own += fetch(values, first + i).y;
    partial[lane] = own;
    barrier();
    if (lane != 0) return;
    int total = added;
    for (uint i = 0; i < gl_WorkGroupSize.x; i++) total += int(partial[i]);
    sums[gl_WorkGroupID.x] = negated ? -total : total;
}
