// Tests of floats on their bits. Vulkan lets a compiler assume that no number is NaN or infinite, and fold isnan(),
// isinf() and negated comparisons away, unless a shader asks for the execution mode SignedZeroInfNanPreserve (Vulkan
// specification, "Precision and Operation of SPIR-V Instructions"); it cannot do so with integers.

bool is_nan(float x) { return (floatBitsToUint(x) & 0x7fffffffu) > 0x7f800000u; }

bool is_finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }

// The least positive float that is not denormal: GPUs may take smaller numbers as zero.
const float LEAST_NORMAL = 1.1754944e-38;
