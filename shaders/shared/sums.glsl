// Sums over a workgroup of several vectors at once, in fixed order (a tree); every lane gets the totals. Needs SIZE, a
// power of two, and SUMS, how many vectors at most.

shared vec4 sums_partial[SUMS * SIZE];

void workgroup_sums(inout vec4 values[SUMS], uint count) {
    uint lane = gl_LocalInvocationID.x;
    for (uint k = 0; k < count; k++) sums_partial[k * SIZE + lane] = values[k];
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) {
            for (uint k = 0; k < count; k++) sums_partial[k * SIZE + lane] += sums_partial[k * SIZE + lane + width];
        }
    }
    barrier();
    for (uint k = 0; k < count; k++) values[k] = sums_partial[k * SIZE];
    barrier();
}
