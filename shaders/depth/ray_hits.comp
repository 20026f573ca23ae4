#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/rounds.glsl"

// Depth stage (narrow phase) of a step, as a compute shader (ray_hits.vert and ray_hits.frag are the version that uses
// the rasterizer): finds where the rays of skin vertices hit the triangles of the other body's skin (surface mesh). A
// contact patch is a column of space in which two bodies may touch, with one normal, along which the rays run. For each
// triangle of an active chunk (a group of at most 64 skin vertices that passed culling), front and back faces alike,
// this kernel visits the cells of the patch's spatial hash that the triangle covers, and tests the vertices there
// (shared/ray_hit.glsl). Each hit goes onto the list of its vertex. One workgroup runs for each work item (an active
// chunk in one patch). The f64 reference implementation is oracle::contact::ray_depths; the test tries all pairs of
// vertex and triangle.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const uint MOST_HITS = 1;

layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer WorkItems { uvec2 work_items[]; };  // active chunk and contact patch of each item
layout(scalar) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, chunk_triangles);      // triangles of chunks, four per texel
layout(scalar) readonly buffer ContactPatches { ContactPatch contact_patches[]; };
READ_ONLY(uvec4, triangles);       // three skin vertices
READ_ONLY(vec4, skin);
READ_ONLY(uvec4, buckets);         // heads of the hash's lists, four per texel; see shared/spatial_hash.glsl
READ_ONLY(uvec4, hash_entries);
READ_ONLY(uvec4, entry_cells);      // cell of each vertex in the hash, two per texel
layout(scalar) buffer EntryHits { uint entry_hits[]; };                      // first hit of each vertex in the hash
layout(scalar) writeonly buffer Hits { uvec4 hits[]; };  // triangle, next hit, depth bits, 2 * work item + (1: front)
layout(scalar) readonly buffer Pairs { Pair pairs[]; };

#include "shared/spatial_hash.glsl"
#include "shared/depth_grid.glsl"
#include "shared/covered_cells.glsl"
#include "shared/ray_hit.glsl"
#include "shared/turns.glsl"

// Number of cells above which all lanes share a triangle.
const uint SHARED = 32;

uint count_of(ivec2 first, ivec2 last) { return uint(last.x - first.x + 1) * uint(last.y - first.y + 1); }

shared uint listed[CHUNK_TRIANGLES];      // triangles that one lane tests
shared uint large[CHUNK_TRIANGLES];       // triangles that all lanes share
shared uint listed_count;
shared uint large_count;

void main() {
    uint lane = gl_LocalInvocationID.x;
    uvec2 work_item = work_items[gl_WorkGroupID.x];
    ActiveChunk entry = active_chunks[work_item.x];
    Chunk chunk = chunks[entry.chunk];
    ContactPatch contact_patch = contact_patches[work_item.y];
    uint side = entry.side & 1, other = 1 - side;
    vec3 corners[3];
    ivec2 first, last;
    // `due` and `done` count the triangles and cells that this lane has to visit and those that it visited: drivers may
    // end loops early (docs/evidence/benchmarks.md, "Two traps"). No triangle is visited if no rays run from the vertices
    // of the other body.
    Pair pair = pairs[entry.side / 2];
    uint triangle_count = casts_rays(pair, other) ? chunk.triangle_count : 0;
    uint due = turns_of(triangle_count), done = 0;
    // Triangles that may be hit are listed first, so that no lane is idle for a triangle that cannot be hit.
    if (lane == 0) listed_count = large_count = 0;
    barrier();
    for (uint t = lane; t < triangle_count; t += SIZE) {
        done++;
        uint at = chunk.triangle_first + t, triangle = fetch(chunk_triangles, at / 4)[at % 4];
        if (covered_cells(contact_patch, work_item.y, side, triangle, corners, first, last)) {
            if (count_of(first, last) > SHARED) large[atomicAdd(large_count, 1)] = triangle;
            else listed[atomicAdd(listed_count, 1)] = triangle;
        }
    }
    barrier();
    due += turns_of(listed_count);
    for (uint k = lane; k < listed_count; k += SIZE) {
        uint triangle = listed[k];
        box_cells(contact_patch, side, triangle, corners, first, last);
        due += count_of(first, last);
        done++;
        done += hit_cells(first, last, 2 * work_item.y + other, corners, side, triangle, gl_WorkGroupID.x);
    }
    // Large triangles: all lanes share the cells of each.
    due += large_count;
    for (uint k = 0; k < large_count; k++) {
        uint triangle = large[k];
        box_cells(contact_patch, side, triangle, corners, first, last);
        uint count = count_of(first, last), width = uint(last.x - first.x + 1);
        due += turns_of(count);
        done++;
        for (uint c = lane; c < count; c += SIZE) {
            ivec2 cell = first + ivec2(c % width, c / width);
            done += hit_cells(cell, cell, 2 * work_item.y + other, corners, side, triangle, gl_WorkGroupID.x);
        }
    }
    if (done != due) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
