#version 460
#extension GL_EXT_scalar_block_layout : require

// View: draws a corner of the triangles of the panel (text and plots over the rendered image). A corner has five
// numbers: position in points (units of the panel's layout) from the upper left corner of the image, two numbers;
// position in the atlas (image of all letters), from 0 to 1, two numbers; colour, one number with a byte for each
// component. One invocation runs for each corner.

layout(scalar) readonly buffer Corners { float corners[]; };      // five numbers per corner

layout(push_constant, scalar) uniform Push {
    vec2 points;    // size of the rendered image, points
    uvec2 atlas;    // size of the atlas, texels
};

layout(location = 0) out vec2 at;
layout(location = 1) out vec4 tint;

void main() {
    int first = 5 * gl_VertexIndex;
    at = vec2(corners[first + 2], corners[first + 3]) * vec2(atlas);
    tint = unpackUnorm4x8(floatBitsToUint(corners[first + 4]));
    gl_Position = vec4(2.0 * vec2(corners[first], corners[first + 1]) / points - 1.0, 0.0, 1.0);
}
