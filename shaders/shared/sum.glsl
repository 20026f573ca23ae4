// Sum of a vector over a workgroup in a fixed order (a tree); every lane gets the total. An including shader declares
// SIZE, the workgroup's size, a power of two.

shared vec4 sum_partial[SIZE];

vec4 workgroup_sum(vec4 value) {
    uint lane = gl_LocalInvocationID.x;
    sum_partial[lane] = value;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) sum_partial[lane] += sum_partial[lane + width];
    }
    barrier();
    vec4 total = sum_partial[0];
    barrier();
    return total;
}
