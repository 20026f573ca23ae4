#version 460

// Test shader of the canvas (images that are rendered onto, src/gpu/canvas.rs), not part of the step: a pixel gets the
// interpolated colour of its triangle's corners. One invocation runs for each pixel.

layout(location = 0) in vec4 own;
layout(location = 0) out vec4 colour;

void main() { colour = own; }
