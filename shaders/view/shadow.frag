#version 460

// View: the depth alone is kept.

void main() {}
