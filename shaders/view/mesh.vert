#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/look.glsl"

// View: a vertex of a mesh, as the draw kernels placed it. Where triangles are as small as pixels the surface is shaded here: on a
// processor a triangle's pixels cost as much as sixteen. One invocation a vertex.

layout(constant_id = 1) const bool AT_VERTICES = false;

layout(scalar, binding = 0) uniform Views { View view; };
layout(binding = 1) uniform samplerBuffer positions;    // m, from the origin
layout(binding = 2) uniform samplerBuffer normals;      // unit, outward
layout(binding = 3) uniform samplerBuffer values;       // four vertices a texel
layout(binding = 4) uniform samplerBuffer shadow;       // depths that the sun sees
layout(binding = 5) uniform samplerBuffer colours;      // of a scale, then of numbers, linear
layout(scalar, binding = 6) readonly buffer Materials { Material materials[]; };
layout(push_constant) uniform Push { uint material_index; };

layout(location = 0) out vec3 x;
layout(location = 1) out vec3 normal;
layout(location = 2) out float value;
layout(location = 3) out vec4 shaded;

#include "shared/shade.glsl"
#include "shared/surface.glsl"

void main() {
    int vertex = gl_VertexIndex;
    x = texelFetch(positions, vertex).xyz;
    normal = texelFetch(normals, vertex).xyz;
    value = texelFetch(values, vertex >> 2)[vertex & 3];
    shaded = AT_VERTICES ? surface(material_index, x, normal, value, lit(x, normal)) : vec4(0.0);
    gl_Position = view.clip * vec4(x, 1.0);
}
