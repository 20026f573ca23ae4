// Declares read-only arrays of vec4 or uvec4; a texel is one element. A shader that has such arrays is compiled twice:
// with storage texel buffers, which lavapipe (Mesa's software Vulkan driver) reads fastest, and with storage buffers,
// for devices that have too few texel buffers or too small ones. The host (CPU side) picks one version for its device.

#ifdef TEXEL_ARRAYS
#define READ_ONLY_vec4(array) layout(rgba32f) readonly uniform imageBuffer array
#define READ_ONLY_uvec4(array) layout(rgba32ui) readonly uniform uimageBuffer array
#define fetch(array, index) imageLoad(array, int(index))
#else
#define READ_ONLY_vec4(array) layout(scalar) readonly buffer array##_block { vec4 array[]; }
#define READ_ONLY_uvec4(array) layout(scalar) readonly buffer array##_block { uvec4 array[]; }
#define fetch(array, index) array[index]
#endif

// `READ_ONLY(vec4, node_rest)` declares an array called node_rest; `fetch(node_rest, i)` reads its element i.
#define READ_ONLY(type, array) READ_ONLY_##type(array)
