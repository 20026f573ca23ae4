#version 460
#extension GL_EXT_scalar_block_layout : require

// Test shader of the canvas (images that are rendered onto, src/gpu/canvas.rs), not part of the step: puts the corners
// of triangles at given places, with given colours. One invocation runs for each corner.

struct Corner {
    vec4 place;     // in clip space
    vec4 colour;    // premultiplied by alpha
};

layout(scalar) readonly buffer Corners { Corner corners[]; };
layout(push_constant, scalar) uniform Push { float aside; };      // shift to the right per instance, in clip space
layout(location = 0) out vec4 colour;

void main() {
    Corner corner = corners[gl_VertexIndex];
    colour = corner.colour;
    gl_Position = corner.place + vec4(aside * float(gl_InstanceIndex), 0.0, 0.0, 0.0);
}
