#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/look.glsl"

// View: draws a vertex of a mesh, which the kernels of shaders/draw have placed. Where triangles are as small as
// pixels, the colour is computed here and interpolated between vertices, because on a CPU rasterizer a triangle costs
// as much as sixteen pixels. One invocation runs for each vertex.

layout(constant_id = 1) const bool AT_VERTICES = false;      // whether the colour is computed here

layout(scalar) uniform Views { View view; };
READ_ONLY(vec4, positions);    // m, relative to an origin that the host (CPU side) chooses
READ_ONLY(vec4, normals);      // unit, outward
READ_ONLY(vec4, values);       // numbers that the colours show, those of four vertices in a texel
READ_ONLY(vec4, shadow);       // shadow map: depths from the sun, four per texel
READ_ONLY(vec4, colours);      // linear RGB: the colour scale of vertex values, then colours for whole-number values
layout(scalar) readonly buffer Materials { Material materials[]; };
layout(push_constant) uniform Push { uint material_index; };

layout(location = 0) out vec3 x;
layout(location = 1) out vec3 normal;
layout(location = 2) out float value;
layout(location = 3) out vec4 shaded;

#include "shared/shade.glsl"
#include "shared/surface.glsl"

void main() {
    int vertex = gl_VertexIndex;
    x = fetch(positions, vertex).xyz;
    normal = fetch(normals, vertex).xyz;
    value = fetch(values, vertex >> 2)[vertex & 3];
    shaded = AT_VERTICES ? surface(material_index, x, normal, value, lit(x, normal)) : vec4(0.0);
    gl_Position = view.clip * vec4(x, 1.0);
}
