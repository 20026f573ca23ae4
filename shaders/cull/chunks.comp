#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/depth_grid.glsl"

// Cull stage (broad phase) of a step: tests the chunks (groups of at most 64 vertices of a skin, a body's surface mesh)
// of an active pair proxy against the pair proxies of the other body. A pair proxy is a collision proxy (convex hull
// around part of a skin) in one pair of bodies a and b. The test uses the axes of each contact patch of the pair proxy
// (`ContactPatch`: a column of space with one contact normal). A frame is a rigid coordinate frame, a link the relative
// placement of two frames. With the frame's centre c and rotation R, embedding weights w_i, rest positions r_i and
// displacements d_i of nodes, a skin vertex is at x = c + R sum w_i (r_i + d_i). So a chunk's skin lies in the chunk's
// box at rest, moved by the middle of its nodes' displacements and grown by (sum |w_i|) times half their spread.
//
// A chunk stays in a patch if that box overlaps the box of a pair proxy of the other body along both tangents, and is
// not separated from it along the normal. The chunk's heights (coordinates along the normal) then enter the min-max
// depth grid of its side, body a or b (shared/depth_grid.glsl), against which cull/meet tests chunks of the other side.
// One workgroup runs for each active pair proxy (one that cull/contact_patches listed). The f64 reference
// implementation is oracle::contact_patches::chunk_box.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool SPANS = false;  // whether a chunk may have nodes in frames other than its proxy's

layout(scalar) readonly buffer Pairs { Pair pairs[]; };
layout(scalar) readonly buffer PairProxies { PairProxy pair_proxies[]; };
layout(scalar) readonly buffer ActivePairProxies { uint active_pair_proxies[]; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
READ_ONLY(uvec4, chunks);
READ_ONLY(uvec4, chunk_nodes);       // two per texel: node, link from the proxy's frame to the node's frame
READ_ONLY(vec4, displacement);
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, links);
READ_ONLY(vec4, contact_patches);
layout(scalar) readonly buffer Boxes { vec3 boxes[]; };  // two corners of each box, PAIR_PATCHES boxes per pair proxy
layout(scalar) readonly buffer ProxyPatches { uint proxy_patches[]; };    // bit mask of each pair proxy's patches
layout(scalar) writeonly buffer PairProxyChunks { uvec2 pair_proxy_chunks[]; };  // x: bit mask of each chunk's patches
layout(scalar) writeonly buffer Slabs { Slab slabs[]; };     // bounds of chunks, PAIR_PATCHES per chunk of a pair proxy
layout(scalar) buffer DepthGrids { uint depth_grids[]; };             // min-max depth grids, see shared/depth_grid.glsl

#include "shared/chunk.glsl"
#include "shared/contact_patch.glsl"
#include "shared/link.glsl"
#include "shared/moved.glsl"

// Cosine of the angle between a chunk's mean normal and the patch's normal below which the chunk's plane is too steep
// to be a bound.
const float STEEP = 0.2;

// Middle of the displacements of a chunk's nodes, and a bound, along each axis, on how far the displacement of a vertex
// of the chunk differs from this middle; both in the proxy's frame, m.
void spread_of(Chunk chunk, out vec3 middle, out vec3 spread) {
    middle = vec3(0.0);
    spread = vec3(0.0);
    if (chunk.node_count == 0) return;
    vec3 least = vec3(3.0e38), greatest = vec3(-3.0e38);
    for (uint k = chunk.node_first; k < chunk.node_first + chunk.node_count; k += 2) {
        uvec4 two = fetch(chunk_nodes, k / 2);
        vec3 d = moved(two.xy), e = moved(two.zw);
        least = min(least, min(d, e));
        greatest = max(greatest, max(d, e));
    }
    middle = 0.5 * (least + greatest);
    // The factor 1.001 covers rounding.
    spread = 1.001 * chunk.weight_bound * 0.5 * (greatest - least);
}

// Enters the bound on a chunk's heights into the cells of its side's depth grid that the chunk covers.
void raise_grid(uint patch_index, ContactPatch contact_patch, uint side, Slab slab) {
    uvec4 range = grid_cells(contact_patch, slab.low, slab.high);
    uint grid = grid_first(patch_index, side);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            uint key = height_key(slab_height(contact_patch, slab, side, uvec2(x, y)));
            if (side == 0) atomicMax(depth_grids[grid + y * GRID + x], key);
            else atomicMin(depth_grids[grid + y * GRID + x], key);
        }
    }
}

// The plane above (for a chunk of b: below) a slab that reaches from `centre` by `thickness` to both sides along
// `normal`, in the patch's axes, as `Slab::plane` keeps it. If this plane is too steep, a level plane at the height
// `extreme` instead.
vec3 plane_of(vec3 centre, vec3 normal, float thickness, uint side, float extreme) {
    if (abs(normal.z) < STEEP) return vec3(0.0, 0.0, extreme);
    vec3 plane = vec3(-normal.xy / normal.z, dot(normal, centre) / normal.z);
    float above = thickness / abs(normal.z);
    return plane + vec3(0.0, 0.0, side == 0 ? above : -above);
}

// Whether a chunk of `side`, with the box from `least` to `greatest`, may touch a pair proxy of the other side in patch
// r.
bool meets(Pair pair, uint side, uint r, vec3 least, vec3 greatest) {
    uint begin = pair.first_pair_proxy[1 - side], count = pair.proxy_count[1 - side];
    for (uint pair_proxy = begin; pair_proxy < begin + count; pair_proxy++) {
        if ((proxy_patches[pair_proxy] & (1u << r)) == 0) continue;
        vec3 low = boxes[2 * (pair_proxy * PAIR_PATCHES + r)], high = boxes[2 * (pair_proxy * PAIR_PATCHES + r) + 1];
        bool beside = any(greaterThan(least.xy, high.xy)) || any(lessThan(greatest.xy, low.xy));
        bool in_front = side == 0 ? greatest.z < low.z : least.z > high.z;
        if (!beside && !in_front) return true;
    }
    return false;
}

void main() {
    uint pair_proxy_index = active_pair_proxies[gl_WorkGroupID.x];
    PairProxy pair_proxy = pair_proxies[pair_proxy_index];
    Pair pair = pairs[pair_proxy.pair];
    Proxy proxy = proxies[pair_proxy.proxy];
    Frame frame = frames[proxy.frame];
    uint bits = proxy_patches[pair_proxy_index] & ((1u << PAIR_PATCHES) - 1);
    for (uint k = gl_LocalInvocationID.x; k < proxy.chunk_count; k += SIZE) {
        Chunk chunk = chunk_at(proxy.chunk_first + k);
        vec3 middle, spread;
        spread_of(chunk, middle, spread);
        vec3 centre = frame.centre + rotate(frame.rotation, chunk.centre + middle);
        mat3 along = mat3(rotate(frame.rotation, chunk.half_extent.x * chunk.axes[0]),
            rotate(frame.rotation, chunk.half_extent.y * chunk.axes[1]),
            rotate(frame.rotation, chunk.half_extent.z * cross(chunk.axes[0], chunk.axes[1])));
        mat3 around = mat3(rotate(frame.rotation, vec3(spread.x, 0.0, 0.0)),
            rotate(frame.rotation, vec3(0.0, spread.y, 0.0)), rotate(frame.rotation, vec3(0.0, 0.0, spread.z)));
        float rounding = 1.0e-6 * (1.0 + length(centre));
        uint found = 0;
        for (uint left = bits; left != 0; left &= left - 1) {
            uint r = findLSB(left);
            ContactPatch contact_patch = contact_patch_at(pair_proxy.pair * PAIR_PATCHES + r);
            mat3 axes = mat3(contact_patch.tangent, contact_patch.bitangent, contact_patch.normal);
            vec3 reach = abs(along[0] * axes) + abs(along[1] * axes) + abs(along[2] * axes)
                + abs(around[0] * axes) + abs(around[1] * axes) + abs(around[2] * axes) + rounding;
            vec3 least = centre * axes - reach, greatest = centre * axes + reach;
            if (pair.is_plane != 0) {
                if (greatest.z >= -pair.plane.w) found |= 1u << r;
                continue;
            }
            bool beside = any(greaterThan(least.xy, contact_patch.high)) || any(lessThan(greatest.xy, contact_patch.low));
            if (beside || !meets(pair, pair_proxy.side, r, least, greatest)) continue;
            found |= 1u << r;
            vec3 normal = rotate(frame.rotation, cross(chunk.axes[0], chunk.axes[1]));
            float thickness = chunk.half_extent.z + dot(abs(normal * around), vec3(1.0)) + rounding;
            float extreme = pair_proxy.side == 0 ? greatest.z : least.z;
            vec3 plane = plane_of(centre * axes, normal * axes, thickness, pair_proxy.side, extreme);
            Slab slab = Slab(least.xy, greatest.xy, plane, extreme);
            slabs[(pair_proxy.chunk_first + k) * PAIR_PATCHES + r] = slab;
            raise_grid(pair_proxy.pair * PAIR_PATCHES + r, contact_patch, pair_proxy.side, slab);
        }
        pair_proxy_chunks[pair_proxy.chunk_first + k] = uvec2(found, 0);
    }
}
