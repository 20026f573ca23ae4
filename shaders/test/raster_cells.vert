#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Test shader of rasterization without attachments (images), not part of the step: draws rectangles of cells, one
// instance of six vertices for each rectangle. A cell is one pixel.

layout(constant_id = 1) const uint RASTER_CELLS = 1;
layout(scalar) readonly buffer Rectangles { ivec4 rectangles[]; };     // first cell (xy) and last cell (zw) of each
layout(push_constant, scalar) uniform Push { uint first_rectangle; };
layout(location = 0) flat out uint colour;

#include "shared/raster_cells.glsl"

void main() {
    uint rectangle = first_rectangle + gl_InstanceIndex;
    ivec4 range = rectangles[rectangle];
    colour = 1 + rectangle;
    gl_Position = no_cells();
    if (all(lessThanEqual(range.xy, range.zw))) gl_Position = corner_of_cells(range.xy, range.zw, gl_VertexIndex % 6);
}
