#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/depth_grid.glsl"
#include "shared/args.glsl"

// Cull stage (broad phase) of a step: lists those chunks (groups of at most 64 vertices of a skin, a body's surface
// mesh) that may reach the other body along the normal of a contact patch (`ContactPatch`: a column of space in which
// two bodies may touch). A pair proxy is a collision proxy (convex hull around part of a skin) in one pair of bodies. A
// chunk of an active pair proxy is listed if it may reach a chunk of the other side (body of the pair) in some cell of
// the patch's depth grid (shared/depth_grid.glsl). One workgroup runs for each active pair proxy.
//
// The last workgroup to finish joins the lists of all pair proxies, in their order: active chunks, a work item for each
// active chunk and patch, and the indirect arguments up to contact/candidates. Pair proxies whose vertices are tested
// for contact come first, so that arrays of vertices need no room for the others. More work items than MAX_WORK_ITEMS
// raise FLAG_PATCH_OVERFLOW. The test compares with a CPU loop over every chunk and every opposing chunk.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint PAIR_PROXIES = 1;
layout(constant_id = 2) const uint MAX_WORK_ITEMS = 1;
layout(constant_id = 3) const uint GATHERING = 1;  // pair proxies whose vertices are tested for contact; they are first

layout(scalar) readonly buffer Pairs { Pair pairs[]; };
layout(scalar) readonly buffer PairProxies { PairProxy pair_proxies[]; };
layout(scalar) readonly buffer ActivePairProxies { uint active_pair_proxies[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
READ_ONLY(vec4, contact_patches);
layout(scalar) readonly buffer Slabs { Slab slabs[]; };  // bounds of chunks, PAIR_PATCHES per chunk of a pair proxy
layout(scalar) readonly buffer DepthGrids { uint depth_grids[]; };               // see shared/depth_grid.glsl
layout(scalar) coherent buffer PairProxyChunks { uvec2 pair_proxy_chunks[]; };  // patch mask; later see list_pair_proxy
layout(scalar) coherent buffer PairProxyCounts { uvec2 pair_proxy_counts[]; };  // chunks, work items; later prefix sums
layout(scalar) writeonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) writeonly buffer WorkItems { uvec2 work_items[]; };  // active chunk and contact patch of each work item
layout(scalar) coherent buffer CountsInOut { Counts counts; };
layout(scalar) writeonly buffer Args { uint args[]; };

#include "shared/contact_patch.glsl"

shared uint masks[SIZE];
shared uvec2 totals[SIZE];
shared bool is_last;

// Whether a chunk of `side` may reach a chunk of the other side in some cell of a patch's depth grid.
bool meets_grid(uint patch_index, uint side, Slab slab) {
    ContactPatch contact_patch = contact_patch_at(patch_index);
    uvec4 range = grid_cells(contact_patch, slab.low, slab.high);
    uint grid = grid_first(patch_index, 1 - side);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            uint key = height_key(slab_height(contact_patch, slab, side, uvec2(x, y)));
            uint other = depth_grids[grid + y * GRID + x];
            if (side == 0 ? key >= other : key <= other) return true;
        }
    }
    return false;
}

// Lists the chunks of a pair proxy that are kept, in their order: the chunk, and the mask of its patches together with
// the number of this pair proxy's work items before it, shifted left by PAIR_PATCHES.
void list_pair_proxy(uint pair_proxy_index) {
    uint lane = gl_LocalInvocationID.x;
    PairProxy pair_proxy = pair_proxies[pair_proxy_index];
    bool is_plane = pairs[pair_proxy.pair].is_plane != 0;
    Proxy proxy = proxies[pair_proxy.proxy];
    uint listed = 0, work_items_listed = 0;
    for (uint first = 0; first < proxy.chunk_count; first += SIZE) {
        uint k = first + lane;
        uint mask = k < proxy.chunk_count ? pair_proxy_chunks[pair_proxy.chunk_first + k].x : 0;
        for (uint r = 0; r < PAIR_PATCHES; r++) {
            if ((mask & (1u << r)) == 0 || is_plane) continue;
            Slab slab = slabs[(pair_proxy.chunk_first + k) * PAIR_PATCHES + r];
            if (!meets_grid(pair_proxy.pair * PAIR_PATCHES + r, pair_proxy.side, slab)) mask &= ~(1u << r);
        }
        masks[lane] = mask;
        barrier();
        uint before = 0, work_items_before = 0, found = 0, work_items_found = 0;
        for (uint l = 0; l < SIZE; l++) {
            uint one = masks[l] != 0 ? 1 : 0, each = bitCount(masks[l]);
            if (l < lane) {
                before += one;
                work_items_before += each;
            }
            found += one;
            work_items_found += each;
        }
        // Writing in place is safe: the list is never longer than what all lanes have read.
        if (mask != 0) {
            pair_proxy_chunks[pair_proxy.chunk_first + listed + before] =
                uvec2(proxy.chunk_first + k, mask | (work_items_listed + work_items_before) << PAIR_PATCHES);
        }
        listed += found;
        work_items_listed += work_items_found;
        barrier();
    }
    if (lane == 0) pair_proxy_counts[pair_proxy_index] = uvec2(listed, work_items_listed);
}

// Joins the lists of all pair proxies; each lane takes a contiguous run of pair proxies.
void list_all() {
    uint lane = gl_LocalInvocationID.x;
    uint run = (PAIR_PROXIES + SIZE - 1) / SIZE;
    uint begin = min(lane * run, PAIR_PROXIES), end = min(begin + run, PAIR_PROXIES);
    uvec2 own = uvec2(0);
    for (uint s = begin; s < end; s++) own += pair_proxy_counts[s];
    totals[lane] = own;
    barrier();
    uvec2 at = uvec2(0), all = uvec2(0);
    for (uint k = 0; k < SIZE; k++) {
        if (k < lane) at += totals[k];
        all += totals[k];
    }
    for (uint s = begin; s < end; s++) {
        uvec2 count = pair_proxy_counts[s];
        pair_proxy_counts[s] = at;
        at += count;
    }
    memoryBarrierBuffer();
    barrier();
    uint listed = min(all.y, MAX_WORK_ITEMS), used = min(all.x, MAX_WORK_ITEMS), done = 0;
    for (uint e = lane; e < used; e += SIZE) {
        done++;
        // Binary search for the last pair proxy whose running total of chunks does not exceed e.
        uint low = 0, high = PAIR_PROXIES;
        while (high - low > 1) {
            uint middle = (low + high) / 2;
            if (pair_proxy_counts[middle].x <= e) low = middle;
            else high = middle;
        }
        uvec2 found = pair_proxy_chunks[pair_proxies[low].chunk_first + e - pair_proxy_counts[low].x];
        uint first_work_item = pair_proxy_counts[low].y + (found.y >> PAIR_PATCHES);
        uint mask = found.y & ((1u << PAIR_PATCHES) - 1u);
        uint work_item = first_work_item;
        for (uint r = 0; r < PAIR_PATCHES; r++) {
            if ((mask & (1u << r)) == 0) continue;
            if (work_item < MAX_WORK_ITEMS) work_items[work_item] = uvec2(e, pair_proxies[low].pair * PAIR_PATCHES + r);
            else mask &= ~(1u << r);
            work_item += 1;
        }
        uint side = 2 * pair_proxies[low].pair + pair_proxies[low].side;
        active_chunks[e] = ActiveChunk(found.x, low, side, mask, first_work_item);
    }
    // The flag is raised if there are more work items than fit, or if the driver ended the loop early.
    if (all.y > MAX_WORK_ITEMS || done != (used + SIZE - 1 - lane) / SIZE) atomicOr(counts.flags, FLAG_PATCH_OVERFLOW);
    if (lane != 0) return;
    uint gathering = min(GATHERING < PAIR_PROXIES ? pair_proxy_counts[GATHERING].x : all.x, used);
    counts.chunks = used;
    counts.gathering = gathering;
    counts.work_items = listed;
    args[3 * ARGS_ACTIVE] = used;
    args[3 * ARGS_GATHERING] = gathering;
    args[3 * ARGS_WORK_ITEMS] = listed;
    args[3 * ARGS_OVERLAPS] = min(GATHERING < PAIR_PROXIES ? pair_proxy_counts[GATHERING].y : all.y, listed);
    args[3 * ARGS_DRAW] = 6 * CHUNK_TRIANGLES;
    args[3 * ARGS_DRAW + 1] = listed;
    args[3 * ARGS_DRAW + 2] = 0;
    args[3 * ARGS_DRAW + 3] = 0;
}

void main() {
    list_pair_proxy(active_pair_proxies[gl_WorkGroupID.x]);
    memoryBarrierBuffer();
    barrier();
    memoryBarrierBuffer();
    if (gl_LocalInvocationID.x == 0) {
        is_last = atomicAdd(counts.pair_proxies_met, 1) == gl_NumWorkGroups.x - 1;
    }
    barrier();
    if (!is_last) return;
    memoryBarrierBuffer();
    list_all();
}
