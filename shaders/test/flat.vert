#version 460
#extension GL_EXT_scalar_block_layout : require

// Canvas self-test: corners where they are told to be, with their colours; stands in no step. One invocation a corner.

struct Corner {
    vec4 place;     // in clip space
    vec4 colour;    // multiplied by its alpha
};

layout(scalar) readonly buffer Corners { Corner corners[]; };
layout(push_constant, scalar) uniform Push { float aside; };      // per instance, to the right
layout(location = 0) out vec4 colour;

void main() {
    Corner corner = corners[gl_VertexIndex];
    colour = corner.colour;
    gl_Position = corner.place + vec4(aside * float(gl_InstanceIndex), 0.0, 0.0, 0.0);
}
