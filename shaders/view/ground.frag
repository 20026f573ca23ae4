#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: the ground, with the shadows on it; it fades into the background. One invocation a pixel.

layout(scalar, binding = 0) uniform Views { View view; };
layout(binding = 4) uniform samplerBuffer shadow;

layout(location = 0) in vec3 x;
layout(location = 0) out vec4 colour;

#include "shared/shade.glsl"

void main() {
    vec3 n = view.ground.xyz;
    vec3 out_from = x - view.middle;
    float distance = length(out_from - dot(out_from, n) * n) / view.reach;
    float share = 1.0 - smoothstep(1.0, 3.6, distance);
    if (share <= 0.0) discard;
    float light = 1.0 - 0.42 * (1.0 - lit(x, n));
    colour = vec4(view.background * light * share, share);
}
