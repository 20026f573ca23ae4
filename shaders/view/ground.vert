#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: draws the part of the ground that the shadow map (image of depths seen from the sun) covers, as two triangles;
// beyond this part ground and background look alike. One invocation runs for each of the six corners.

layout(scalar) uniform Views { View view; };

layout(location = 0) out vec3 x;

void main() {
    const vec2 CORNERS[6] = vec2[](vec2(-1, -1), vec2(1, -1), vec2(1, 1), vec2(-1, -1), vec2(1, 1), vec2(-1, 1));
    vec2 corner = CORNERS[gl_VertexIndex];
    vec3 from = view.middle + view.reach * (corner.x * view.across[0] + corner.y * view.across[1]);
    // The corner is projected to the ground along the sun's rays.
    vec3 n = view.ground.xyz;
    x = from + (view.ground.w - dot(n, from)) / dot(n, view.sun) * view.sun;
    gl_Position = view.clip * vec4(x, 1.0);
}
