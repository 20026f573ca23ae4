#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: what the sun sees. One invocation a vertex of the meshes that cast shadows.

layout(scalar, binding = 0) uniform Views { View view; };
layout(binding = 1) uniform samplerBuffer positions;    // m, from the origin

void main() {
    vec3 place = (view.light * vec4(texelFetch(positions, gl_VertexIndex).xyz, 1.0)).xyz;
    gl_Position = vec4(2.0 * place.xy - 1.0, place.z, 1.0);
}
