#version 460
// Raster self-test: writes the triangle's colour through a table; stands in no step. One invocation per fragment.
#extension GL_EXT_scalar_block_layout : require
layout(constant_id = 1) const uint added = 0;
layout(scalar, set = 0, binding = 1) readonly buffer Table { uint table[]; };
layout(location = 0) flat in uint colour;
layout(location = 0) out uint texel;

void main() {
    texel = table[colour] + added;
}
