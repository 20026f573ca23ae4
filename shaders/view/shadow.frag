#version 460

// View: draws the shadow map (image of depths seen from the sun). Only the depth of each fragment is kept.

void main() {}
