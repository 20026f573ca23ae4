#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/look.glsl"

// View: draws the shadow map, an image of depths seen from the sun. One invocation runs for each vertex of the meshes
// that cast shadows.

layout(scalar) uniform Views { View view; };
READ_ONLY(vec4, positions);    // m, relative to an origin that the host (CPU side) chooses

void main() {
    vec3 place = (view.light * vec4(fetch(positions, gl_VertexIndex).xyz, 1.0)).xyz;
    gl_Position = vec4(2.0 * place.xy - 1.0, place.z, 1.0);
}
