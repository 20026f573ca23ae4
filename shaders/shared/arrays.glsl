// Declares read-only arrays of vec4 or uvec4; a texel is one element. A shader that has such arrays is compiled twice:
// with texel buffers, which lavapipe (Mesa's software Vulkan driver) reads faster, and with storage buffers, for
// devices whose texel buffers hold too few elements. The host (CPU side) picks one version for its device.

#ifdef TEXEL_ARRAYS
// Without this extension GLSL has texel buffers as sampled images only, which SPIR-V 1.6 forbids and SwiftShader does
// not know.
#extension GL_EXT_samplerless_texture_functions : require
#define READ_ONLY_vec4(array) uniform textureBuffer array
#define READ_ONLY_uvec4(array) uniform utextureBuffer array
#define fetch(array, index) texelFetch(array, int(index))
#else
#define READ_ONLY_vec4(array) layout(scalar) readonly buffer array##_block { vec4 array[]; }
#define READ_ONLY_uvec4(array) layout(scalar) readonly buffer array##_block { uvec4 array[]; }
#define fetch(array, index) array[index]
#endif

// `READ_ONLY(vec4, node_rest)` declares an array called node_rest; `fetch(node_rest, i)` reads its element i.
#define READ_ONLY(type, array) READ_ONLY_##type(array)
