#version 460
#extension GL_EXT_scalar_block_layout : require

// View: the panel's triangles, tinted texels of the atlas, between four texels by their distance. Colours are as shown, and
// multiplied by their alpha. One invocation a pixel.

layout(scalar, binding = 1) readonly buffer Atlas { uint texels[]; };

layout(push_constant, scalar) uniform Push {
    vec2 points;    // size of the picture
    uvec2 atlas;    // size of the atlas, texels
};

layout(location = 0) in vec2 at;
layout(location = 1) in vec4 tint;
layout(location = 0) out vec4 colour;

vec4 texel(ivec2 place) {
    ivec2 inside = clamp(place, ivec2(0), ivec2(atlas) - 1);
    return unpackUnorm4x8(texels[uint(inside.y) * atlas.x + uint(inside.x)]);
}

void main() {
    vec2 corner = floor(at - 0.5), share = at - 0.5 - corner;
    ivec2 low = ivec2(corner);
    vec4 upper = mix(texel(low), texel(low + ivec2(1, 0)), share.x);
    vec4 lower = mix(texel(low + ivec2(0, 1)), texel(low + 1), share.x);
    colour = tint * mix(upper, lower, share.y);
}
