#version 460

// View: fragments of the shadow map, of which only the depth is kept.

void main() {}
