// Declares arrays of vec4 or uvec4; a texel is one element. A shader that has such arrays is compiled twice: with storage
// texel buffers, which lavapipe (Mesa's software Vulkan driver) reads fastest, and with storage buffers, for devices
// that have too few texel buffers or too small ones. The host (CPU side) picks one version for its device.

#ifdef TEXEL_ARRAYS
#define READ_ONLY_vec4(array) layout(rgba32f) readonly uniform imageBuffer array
#define READ_ONLY_uvec4(array) layout(rgba32ui) readonly uniform uimageBuffer array
#define READ_WRITE_vec4(array) layout(rgba32f) uniform imageBuffer array
#define READ_WRITE_uvec4(array) layout(rgba32ui) uniform uimageBuffer array
#define fetch(array, index) imageLoad(array, int(index))
#define store(array, index, value) imageStore(array, int(index), value)
#else
#define READ_ONLY_vec4(array) layout(scalar) readonly buffer array##_block { vec4 array[]; }
#define READ_ONLY_uvec4(array) layout(scalar) readonly buffer array##_block { uvec4 array[]; }
#define READ_WRITE_vec4(array) layout(scalar) buffer array##_block { vec4 array[]; }
#define READ_WRITE_uvec4(array) layout(scalar) buffer array##_block { uvec4 array[]; }
#define fetch(array, index) array[index]
#define store(array, index, value) array[index] = value
#endif

// `READ_ONLY(vec4, node_rest)` declares an array called node_rest; `fetch(node_rest, i)` reads its element i.
#define READ_ONLY(type, array) READ_ONLY_##type(array)

// `READ_WRITE(vec4, solution)` declares an array that is also written, with `store(solution, i, value)`. An array that is
// only written is a storage buffer, which lavapipe writes faster.
#define READ_WRITE(type, array) READ_WRITE_##type(array)

// Element k of an array of pairs, from the texel k / 2, which holds two of them.
uvec2 half_of(uvec4 texel, uint k) { return k % 2 == 0 ? texel.xy : texel.zw; }
vec2 half_of(vec4 texel, uint k) { return k % 2 == 0 ? texel.xy : texel.zw; }
