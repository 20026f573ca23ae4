#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: a square of the ground around the scene. Four invocations, two triangles.

layout(scalar, binding = 0) uniform Views { View view; };

layout(location = 0) out vec3 x;

void main() {
    const vec2 CORNERS[6] = vec2[](vec2(-1, -1), vec2(1, -1), vec2(1, 1), vec2(-1, -1), vec2(1, 1), vec2(-1, 1));
    vec3 n = view.ground.xyz;
    vec3 u = normalize(abs(n.x) < 0.9 ? cross(n, vec3(1, 0, 0)) : cross(n, vec3(0, 1, 0)));
    vec3 below = view.middle - (dot(n, view.middle) - view.ground.w) * n;
    vec2 corner = 4.0 * view.reach * CORNERS[gl_VertexIndex];
    x = below + corner.x * u + corner.y * cross(n, u);
    gl_Position = view.clip * vec4(x, 1.0);
}
