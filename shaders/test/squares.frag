#version 460
#extension GL_EXT_scalar_block_layout : require

// Raster self-test: adds the rectangle's colour to the square; stands in no step. One invocation a square.

layout(constant_id = 1) const uint SQUARES = 1;
layout(scalar) buffer Squares { uint squares[]; };
layout(location = 0) flat in uint colour;

void main() {
    uvec2 at = uvec2(gl_FragCoord.xy);
    atomicAdd(squares[at.y * SQUARES + at.x], colour);
}
