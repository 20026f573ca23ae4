#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Skin: computes the positions of the skin vertices of an active chunk (a group of at most 64 skin vertices that passed
// culling), and of neighbouring vertices that its normals need. On a soft body a vertex lies at x = sum w_i (c_i + R_i
// (r_i + d_i)), summed over the four nodes that it is embedded in, each with weight w_i, rest position r_i and
// displacement d_i in a frame (rigid coordinate frame) with centre c_i and rotation R_i; on a rigid body, with position
// r in the body's frame, at x = c + R r. Each chunk that lists a vertex writes the same position for it.
//
// If the chunk's vertices are tested for contact, its own vertices go into the spatial hash of each of its contact
// patches (`ContactPatch`: a column of space where two bodies, its sides, may touch). There the depth stage looks them
// up for each triangle. Vertices in front of all skin of the other side are left out. A work item is a chunk in one
// contact patch. One workgroup runs for each active chunk. The f64 reference is oracle::proximity::embed; the test also
// checks the contents of the hash.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BUCKETS = 1;
layout(constant_id = 2) const bool SPANS = false;       // whether a skin vertex may have nodes in several frames

READ_ONLY(uvec4, frames);
layout(scalar) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
layout(scalar) readonly buffer PairProxies { PairProxy pair_proxies[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, chunk_vertices);  // skin vertices of chunks, four per texel
READ_ONLY(uvec4, skin_nodes);      // the four nodes of each skin vertex; the first is NONE for a rigid skin
READ_ONLY(vec4, skin_weights);     // the four nodes' weights; for a rigid skin the position in the frame, m
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_info);       // z: index of the node's frame
READ_ONLY(vec4, contact_patches);
READ_ONLY(vec4, shares);           // weights of the contact patches at a pair proxy's vertices, one texel each
layout(scalar) writeonly buffer Skin { vec4 skin[]; };
layout(scalar) buffer Buckets { uint buckets[]; };  // hash lists' heads, then sort keys, see shared/spatial_hash.glsl
layout(scalar) writeonly buffer HashEntries { uvec4 hash_entries[]; };       // CHUNK_VERTICES for each work item
layout(scalar) writeonly buffer EntryHits { uint entry_hits[]; };     // first hit on each vertex's ray, here NONE
layout(scalar) writeonly buffer EntryCells { uvec2 entry_cells[]; };      // cell of each vertex in the hash
READ_ONLY(uvec4, depth_grids);  // least and greatest heights of chunks (shared/depth_grid.glsl), four cells a texel

#include "shared/frame.glsl"
#include "shared/contact_patch.glsl"
#include "shared/spatial_hash.glsl"
#include "shared/depth_grid.glsl"

shared vec3 own[CHUNK_VERTICES];

vec3 node_position(uint node) { return fetch(node_rest, node).xyz + fetch(displacement, node).xyz; }

vec3 world(uint node) {
    Frame frame = frame_at(fetch(node_info, node).z);
    return frame.centre + rotate(frame.rotation, node_position(node));
}

// World position of a skin vertex, m; `frame` is the frame of the collision proxy that covers the vertex.
vec3 position(Frame frame, uint vertex) {
    uvec4 nodes = fetch(skin_nodes, vertex);
    vec4 weights = fetch(skin_weights, vertex);
    if (SPANS && nodes.x != NONE) {
        return weights.x * world(nodes.x) + weights.y * world(nodes.y) + weights.z * world(nodes.z)
            + weights.w * world(nodes.w);
    }
    vec3 local = weights.xyz;
    if (nodes.x != NONE) {
        local = weights.x * node_position(nodes.x) + weights.y * node_position(nodes.y)
            + weights.z * node_position(nodes.z) + weights.w * node_position(nodes.w);
    }
    return frame.centre + rotate(frame.rotation, local);
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    ActiveChunk entry = active_chunks[gl_WorkGroupID.x];
    Chunk chunk = chunks[entry.chunk];
    Frame frame = frame_at(proxies[pair_proxies[entry.pair_proxy].proxy].frame);
    for (uint l = lane; l < chunk.embed_count; l += SIZE) {
        uint v = chunk.vertex_first + l, vertex = fetch(chunk_vertices, v / 4)[v % 4];
        vec3 x = position(frame, vertex);
        skin[vertex] = vec4(x, 1.0);
        if (l < chunk.vertex_count) own[l] = x;
    }
    barrier();
    Pair pair = pairs[entry.side / 2];
    uint side = entry.side & 1, work_item = entry.first_work_item;
    if (!casts_rays(pair, side)) return;
    vec4 shares_here = fetch(shares, entry.pair_proxy);
    for (uint left = entry.contact_patches; left != 0; left &= left - 1) {
        uint r = findLSB(left);
        uint patch_index = (entry.side / 2) * PAIR_PATCHES + r, patch_side = 2 * patch_index + side;
        ContactPatch contact_patch = contact_patch_at(patch_index);
        bool sees = shares_here[r] > 0.0;
        for (uint l = lane; l < chunk.vertex_count; l += SIZE) {
            uint hash_entry = work_item * CHUNK_VERTICES + l;
            entry_hits[hash_entry] = NONE;
            vec3 at = along(contact_patch, own[l]);
            if (!sees || any(lessThan(at.xy, contact_patch.low)) || any(greaterThan(at.xy, contact_patch.high))) continue;
            // A vertex in front of everything that the other side's chunks reach cannot collide.
            uvec2 grid_cell = grid_cells(contact_patch, at.xy, at.xy).xy;
            uint grid = grid_first(patch_index, 1 - side) + grid_cell.y * GRID + grid_cell.x;
            uint other = fetch(depth_grids, grid / 4)[grid % 4];
            if (side == 0 ? height_key(at.z) < other : height_key(at.z) > other) continue;
            ivec2 cell = cell_of(contact_patch, side, at.xy);
            uint next = atomicExchange(buckets[bucket_of(cell, patch_side)], hash_entry);
            hash_entries[hash_entry] = uvec4(floatBitsToUint(at), next);
            entry_cells[hash_entry] = cell_key(cell, patch_side);
            uint search_depth = BUCKETS + grid_first(patch_index, side) + grid_cell.y * GRID + grid_cell.x;
            atomicMin(buckets[search_depth], depth_key(1 - side, at.z));
        }
        work_item += 1;
    }
}
