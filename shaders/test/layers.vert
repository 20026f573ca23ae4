#version 460
// Raster self-test: triangles of corner positions in clip space, fetched by number; stands in no step.
// One invocation per corner; the colour is base plus the triangle's number.
#extension GL_EXT_scalar_block_layout : require
layout(set = 0, binding = 0) uniform samplerBuffer corners;
layout(push_constant, scalar) uniform Push { uint base; };
layout(location = 0) flat out uint colour;

void main() {
    gl_Position = vec4(texelFetch(corners, gl_VertexIndex).xyz, 1.0);
    colour = base + uint(gl_VertexIndex) / 3;
}
