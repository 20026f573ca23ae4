#version 460

// Depth, graphics path: the triangle's name where its texel belongs to the tile.

layout(location = 0) flat in uint triangle_name;
layout(location = 1) in vec2 tile_position;
layout(location = 2) flat in vec2 tile_size;

layout(location = 0) out uint name;

void main() {
    if (any(lessThan(tile_position, vec2(0.0))) || any(greaterThanEqual(tile_position, tile_size))) discard;
    name = triangle_name;
}
