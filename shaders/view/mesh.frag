#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/look.glsl"

// View: colour of a pixel of a mesh in a rendered image. One invocation runs for each pixel.

layout(constant_id = 1) const bool AT_VERTICES = false;      // whether mesh.vert has computed the colour

layout(scalar) uniform Views { View view; };
READ_ONLY(vec4, shadow);                                     // shadow map: depths from the sun, four per texel
READ_ONLY(vec4, colours);      // linear RGB: the colour scale of vertex values, then colours for whole-number values
layout(scalar) readonly buffer Materials { Material materials[]; };
layout(push_constant) uniform Push { uint material_index; };

layout(location = 0) in vec3 x;
layout(location = 1) in vec3 normal;
layout(location = 2) in float value;
layout(location = 3) in vec4 shaded;
layout(location = 0) out vec4 colour;

#include "shared/shade.glsl"
#include "shared/surface.glsl"

void main() {
    if (AT_VERTICES) {
        colour = shaded;
        return;
    }
    vec3 n = normalize(normal);
    if ((materials[material_index].flags & FLAT) != 0) {
        n = normalize(cross(dFdx(x), dFdy(x)));
        n = dot(n, view.eye - x) < 0.0 ? -n : n;
    }
    colour = surface(material_index, x, n, value, lit(x, n));
}
