#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"

// Depth stage (narrow phase) of a step, as a vertex shader: draws the cells of a contact patch's spatial hash that a
// triangle covers as a rectangle, so that the rasterizer distributes the cells, one fragment for each (ray_hits.frag).
// A contact patch is a column of space in which two bodies may touch; a chunk is a group of vertices of a skin (a
// body's surface mesh) with their triangles, active if it passed culling. One instance is drawn for each work item (an
// active chunk in one contact patch), with six vertices for each triangle. The graphics pipeline finds the same hits as
// ray_hits.comp, bit for bit.

layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 3) const uint RASTER_CELLS = 1;      // cells along a side of the viewport, one pixel each

layout(scalar) readonly buffer WorkItems { uvec2 work_items[]; };  // active chunk and contact patch of each item
layout(scalar) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, chunk_triangles);      // triangles of chunks, four per texel
layout(scalar) readonly buffer ContactPatches { ContactPatch contact_patches[]; };
READ_ONLY(uvec4, triangles);       // three skin vertices
READ_ONLY(vec4, skin);
READ_ONLY(uvec4, buckets);         // hash lists and depth grids, four per texel; see shared/spatial_hash.glsl
layout(scalar) readonly buffer Pairs { Pair pairs[]; };

layout(location = 0) flat out vec3 corners[3];      // along the patch's axes, m
layout(location = 3) flat out uvec3 triangle_at;    // triangle, 2 * patch + (1: triangle of body b), work item

#include "shared/spatial_hash.glsl"
#include "shared/depth_grid.glsl"
#include "shared/covered_cells.glsl"
#include "shared/raster_cells.glsl"

void main() {
    uvec2 work_item = work_items[gl_InstanceIndex];
    ActiveChunk entry = active_chunks[work_item.x];
    Chunk chunk = chunks[entry.chunk];
    gl_Position = no_cells();
    uint t = gl_VertexIndex / 6;
    Pair pair = pairs[entry.side / 2];
    uint side = entry.side & 1, at = chunk.triangle_first + t;
    if (t >= chunk.triangle_count || !casts_rays(pair, 1 - side)) return;
    uint triangle = fetch(chunk_triangles, at / 4)[at % 4];
    ivec2 first, last;
    bool any_covered = covered_cells(contact_patches[work_item.y], work_item.y, side, triangle, corners, first, last);
    triangle_at = uvec3(triangle, 2 * work_item.y + side, gl_InstanceIndex);
    if (any_covered) gl_Position = corner_of_cells(first, last, gl_VertexIndex % 6);
}
