#version 460
#extension GL_EXT_scalar_block_layout : require

// Test shader of rasterization without attachments (images), not part of the step: adds 1 + the index of a rectangle of
// cells to the cell at the pixel. A cell is one pixel, with a number in `raster_cells`. One invocation runs for each
// cell of a rectangle.

layout(constant_id = 1) const uint RASTER_CELLS = 1;
layout(scalar) buffer RasterCells { uint raster_cells[]; };
layout(location = 0) flat in uint colour;

void main() {
    uvec2 at = uvec2(gl_FragCoord.xy);
    atomicAdd(raster_cells[at.y * RASTER_CELLS + at.x], colour);
}
