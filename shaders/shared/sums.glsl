// Sums of several vectors over a workgroup at once, in an order that is the same each time; every lane gets the
// totals. Where the workgroup is one subgroup, as on a CPU, the subgroup adds them, without shared memory and
// barriers, in the driver's order. Elsewhere the vectors' components are shared out to the lanes: a lane sums a
// component over all lanes, or, in a workgroup of more than 32 lanes, over one of several parts of the lanes. An
// including shader declares SIZE, the workgroup's size, and SUMS, the greatest number of vectors, and enables
// GL_KHR_shader_subgroup_arithmetic.

layout(constant_id = 30) const bool ONE_SUBGROUP = false;     // set by src/gpu/kernel.rs: the workgroup is one subgroup

const uint SUM_PARTS = SIZE > 32 ? SIZE / 32 : 1;      // number of parts into which the lanes are divided
const uint SUM_SHARE = SIZE / SUM_PARTS;               // number of lanes in a part

// A word of padding after each part: lanes read different parts, which would all begin in the same memory bank.
const uint SUM_STRIDE = SIZE + SUM_PARTS;
shared float sums_of_lanes[4 * SUMS * SUM_STRIDE];
shared float sums_of_parts[4 * SUMS * SUM_PARTS];

void workgroup_sums(inout vec4 values[SUMS], uint count) {
    if (ONE_SUBGROUP) {
        for (uint k = 0; k < count; k++) values[k] = subgroupAdd(values[k]);
        return;
    }
    uint lane = gl_LocalInvocationID.x, numbers = 4 * count;
    for (uint k = 0; k < count; k++) {
        for (uint l = 0; l < 4; l++) sums_of_lanes[(4 * k + l) * SUM_STRIDE + lane + lane / SUM_SHARE] = values[k][l];
    }
    barrier();
    for (uint at = lane; at < numbers * SUM_PARTS; at += SIZE) {
        uint first = at * (SUM_SHARE + 1);
        float sum = 0.0;
        for (uint k = first; k < first + SUM_SHARE; k++) sum += sums_of_lanes[k];
        sums_of_parts[at] = sum;
    }
    barrier();
    for (uint k = 0; k < count; k++) {
        for (uint l = 0; l < 4; l++) {
            float sum = 0.0;
            for (uint part = 0; part < SUM_PARTS; part++) sum += sums_of_parts[(4 * k + l) * SUM_PARTS + part];
            values[k][l] = sum;
        }
    }
    barrier();
}
