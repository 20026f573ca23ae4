#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/look.glsl"

// View: colour of a pixel of the ground in a rendered image. Only shadows are drawn; elsewhere the ground has the
// colour of the background. One invocation runs for each pixel.

layout(scalar) uniform Views { View view; };
READ_ONLY(vec4, shadow);      // shadow map: depths from the sun, four per texel

layout(location = 0) in vec3 x;
layout(location = 0) out vec4 colour;

#include "shared/shade.glsl"

void main() {
    vec3 n = view.ground.xyz;
    // The shadow fades with the distance along the ground from the middle of the scene.
    vec3 out_from = x - view.middle;
    float distance = length(out_from - dot(out_from, n) * n) / view.reach;
    float share = 0.36 * (1.0 - smoothstep(0.8, 2.6, distance)) * (1.0 - lit(x, n));
    colour = vec4(0.0, 0.0, 0.0, share);
}
