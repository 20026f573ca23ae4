#version 460

// Test shader of the canvas (src/gpu/canvas.rs), not part of the step: the interpolated colour of the corners. One
// invocation runs for each pixel.

layout(location = 0) in vec4 own;
layout(location = 0) out vec4 colour;

void main() { colour = own; }
