#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: a vertex of a mesh, as the draw kernels placed it. One invocation a vertex.

layout(scalar, binding = 0) uniform Views { View view; };
layout(binding = 1) uniform samplerBuffer positions;    // m, from the origin
layout(binding = 2) uniform samplerBuffer normals;      // unit, outward
layout(binding = 3) uniform samplerBuffer values;       // four vertices a texel

layout(location = 0) out vec3 x;
layout(location = 1) out vec3 normal;
layout(location = 2) out float value;

void main() {
    int vertex = gl_VertexIndex;
    x = texelFetch(positions, vertex).xyz;
    normal = texelFetch(normals, vertex).xyz;
    value = texelFetch(values, vertex >> 2)[vertex & 3];
    gl_Position = view.clip * vec4(x, 1.0);
}
