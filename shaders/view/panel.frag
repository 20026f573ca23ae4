#version 460
#extension GL_EXT_scalar_block_layout : require

// View: colour of a pixel of the panel (text and plots over the rendered image): a texel of an atlas (image of all
// letters) times the colour that panel.vert gives. Letters lie on whole pixels, so the nearest texel is exact. Colours
// are sRGB, premultiplied by alpha. One invocation runs for each pixel.

layout(scalar) readonly buffer Atlas { uint texels[]; };      // texels of the atlas, four bytes each

layout(push_constant, scalar) uniform Push {
    vec2 points;    // size of the rendered image, points (units of the panel's layout)
    uvec2 atlas;    // size of the atlas, texels
};

layout(location = 0) in vec2 at;
layout(location = 1) in vec4 tint;
layout(location = 0) out vec4 colour;

void main() {
    uvec2 place = uvec2(clamp(ivec2(floor(at)), ivec2(0), ivec2(atlas) - 1));
    colour = tint * unpackUnorm4x8(texels[place.y * atlas.x + place.x]);
}
