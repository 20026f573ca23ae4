#version 460
#extension GL_EXT_scalar_block_layout : require

// View: pixels of the panel (text and plots over the rendered image): texels of an atlas of letters, times a colour.
// Letters lie on whole pixels, so the nearest texel is exact. Colours are sRGB, premultiplied by alpha. One invocation
// runs for each pixel.

layout(scalar) readonly buffer Atlas { uint texels[]; };      // four bytes each

layout(push_constant, scalar) uniform Push {
    vec2 points;    // size of the rendered image, points
    uvec2 atlas;    // size of the atlas, texels
};

layout(location = 0) in vec2 at;
layout(location = 1) in vec4 tint;
layout(location = 0) out vec4 colour;

void main() {
    uvec2 place = uvec2(clamp(ivec2(floor(at)), ivec2(0), ivec2(atlas) - 1));
    colour = tint * unpackUnorm4x8(texels[place.y * atlas.x + place.x]);
}
