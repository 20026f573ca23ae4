#version 460

// Canvas self-test: the colour of the corners; stands in no step. One invocation a pixel.

layout(location = 0) in vec4 own;
layout(location = 0) out vec4 colour;

void main() { colour = own; }
