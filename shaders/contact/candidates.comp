#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rounds.glsl"
#include "shared/finite.glsl"
#include "shared/args.glsl"

// Contact stage (narrow phase) of a step: finds the penetration depth of vertices of a skin (a body's surface mesh).
// One workgroup runs for each active chunk (a group of at most 64 skin vertices that passed culling) whose vertices are
// tested for contact. A contact patch (`ContactPatch`) is a column of space where bodies a and b may touch, with a
// normal from a to b; a work item is an active chunk in one contact patch. A collision proxy is a convex hull around
// part of a skin.
//
// In each contact patch that contains a vertex, one ray runs from the vertex, parallel to the normal, back through the
// vertex's own body. The depth stage has listed the triangles of the other body that the ray hits. The nearest hit
// decides: if the ray leaves the other body there (front of a triangle), the vertex lies within that body, otherwise
// not. The vertex becomes one contact, however many patches contain it. With d_r the depth in patch r, and w_r the
// weight of patch r at the vertices of the chunk's proxy (`shares`), the strongest patch is that of the greatest
// w_r / d_r^2; it gives the triangle. Another patch contributes to depth and normal if its w_r / d_r^2 is more than
// half the greatest, and fully if it equals the greatest, so that the contact does not jump when another patch becomes
// the strongest. A half-space with unit normal N and an offset needs no ray: a vertex at x has the depth offset - N.x.
// Only vertices that face the other body take part. A contact's area is the vertex's area at rest, projected along the
// normal, and halved where vertices of both bodies are tested.
//
// Where a pair's contacts are found by triangles, a candidate is made of the overlap of each triangle of the chunk
// (depth/overlaps) instead.
//
// The result for a vertex, a candidate, is stored at the vertex's place in its chunk, with the vertex's side: 2 * pair
// of bodies + (0: the vertex belongs to body a, 1: to body b). The last workgroup to finish lists all candidates that
// collide, in an order that is the same on every device. If there are more than CAPACITY, a flag reports it, and
// contact/deepest lists the deepest instead. The f64 reference implementations are oracle::contact::ray_depths and
// oracle::contact_patches::blend.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const bool BLEND = true;  // false: the strongest patch alone counts, with the depth of its ray
layout(constant_id = 2) const uint CAPACITY = 1;
layout(constant_id = 3) const bool SKINS = true;  // whether rays run; false: vertices meet half-spaces only
layout(constant_id = 4) const bool OVERLAPS = false;  // whether pairs exist whose contacts are found by triangles
layout(constant_id = 5) const uint SLOTS = CHUNK_VERTICES;  // places for candidates of an active chunk: 64 or, with OVERLAPS, 128

layout(scalar) uniform Params { StepParams params; };
layout(scalar) coherent buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, chunk_vertices);      // skin vertices, chunk by chunk, four per texel
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
READ_ONLY(vec4, contact_patches);
READ_ONLY(vec4, shares);                 // weights of patches at each proxy's vertices, in each pair
READ_ONLY(uvec4, triangles);           // three skin vertices of each triangle
READ_ONLY(vec4, skin);
READ_ONLY(uvec4, fan_first);       // four per texel: first entry of each vertex in `fans`, then the end
READ_ONLY(uvec4, fans);            // four per texel: triangles around each vertex
layout(scalar) readonly buffer Areas { float areas[]; };          // rest area of each vertex, m^2
READ_ONLY(uvec4, entry_hits);           // first hit on the ray of each vertex in a work item, four per texel
READ_ONLY(uvec4, hits);  // triangle, next hit on the ray, bits of the depth, 2 * triangle's work item + (1: front)
layout(scalar) writeonly buffer CandidateHits { vec4 candidate_hits[]; };  // depth (m), barycentric weights, area (m^2)
layout(scalar) writeonly buffer CandidateWhat { uvec4 candidate_what[]; };    // vertex, its side, triangle
layout(scalar) writeonly buffer CandidateNormals { vec4 candidate_normals[]; };   // unit, a to b; stiffening
// Bits of the push, which is depth times rest area times the vertex's normal without walls, and the pair of proxies.
layout(scalar) writeonly buffer CandidatePushes { uvec4 candidate_pushes[]; };
layout(scalar) readonly buffer WorkItems { uvec2 work_items[]; };  // active chunk and contact patch of each work item
layout(scalar) writeonly buffer ContactSource { uint contact_source[]; };         // candidate of each contact
layout(scalar) writeonly buffer Args { uint args[]; };
layout(scalar) coherent buffer ChunkContacts { uint chunk_contacts[]; };  // a bit for each place of a chunk: it collides
READ_ONLY(uvec4, chunk_triangles);      // triangles of chunks, four per texel
layout(scalar) readonly buffer Overlaps { Overlap overlaps[]; };
layout(scalar) readonly buffer OverlapAt { uint overlap_at[]; };   // CHUNK_TRIANGLES for each work item: overlap, or NONE

#include "shared/contact_patch.glsl"

// Cosines of the angle between a contact's normal and a triangle around a vertex: above the second the triangle is a
// face that lies on the contact, below the first it is none. Where there is a face, what is steeper than WALL counts
// the less the steeper it is.
const vec2 FACE = vec2(0.7, 0.95);
const float WALL = 0.5;

// Unit outward normal of a skin vertex, from the area vectors of the triangles around it. `faced`: the same without the
// walls beside a face that lies on a contact with the normal `towards`.
vec3 outward_normal(uint vertex, vec3 towards, out vec3 faced) {
    vec3 all = vec3(0.0), facing = vec3(0.0);
    float greatest = 0.0;
    uint begin = fetch(fan_first, vertex / 4)[vertex % 4], end = fetch(fan_first, (vertex + 1) / 4)[(vertex + 1) % 4];
    for (uint k = begin; k < end; k++) {
        uvec3 corners = fetch(triangles, fetch(fans, k / 4)[k % 4]).xyz;
        vec3 p = fetch(skin, corners.x).xyz;
        vec3 area = cross(fetch(skin, corners.y).xyz - p, fetch(skin, corners.z).xyz - p);
        float length2 = dot(area, area);
        float cosine = length2 > 0.0 ? dot(area, towards) * inversesqrt(length2) : 0.0;
        all += area;
        facing += smoothstep(0.0, WALL, cosine) * area;
        greatest = max(greatest, cosine);
    }
    faced = mix(all, facing, smoothstep(FACE.x, FACE.y, greatest));
    float length2 = dot(all, all), faced2 = dot(faced, faced);
    faced *= faced2 > 0.0 ? inversesqrt(faced2) : 0.0;
    return length2 > 0.0 ? all * inversesqrt(length2) : vec3(0.0);
}

// A number above every index of a hit; shared/ray_hit.glsl explains why loops test against it.
const uint ALL_HITS = 0x80000000u;

// Returns the nearest hit on the ray of the vertex with index `hash_entry` among the vertices of all work items, and of
// equally near hits that on the triangle with the lowest index: the triangle (NONE: no hit), 2 * its work item + (1:
// front face), bits of the depth. `through`: whether the ray also meets the back of a triangle within depth_limit.
uvec3 nearest_ray_hit(uint hash_entry, out bool through) {
    uvec3 best = uvec3(NONE, 0, 0);
    float depth = 3.0e38, back = 3.0e38;
    uint hit = fetch(entry_hits, hash_entry / 4)[hash_entry % 4];
    for (uint k = 0; hit < ALL_HITS && k < MOST_ROUNDS; k++) {
        uvec4 found = fetch(hits, hit);
        float d = uintBitsToFloat(found.z);
        if (d < depth || (d == depth && found.x < best.x)) {
            depth = d;
            best = found.xwz;
        }
        if ((found.w & 1) == 0) back = min(back, d);
        hit = found.y;
    }
    if (hit != NONE) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    through = back < params.depth_limit;
    return best;
}

// Depth (m), and barycentric weights of the second and third corner, where the line along the patch's normal through x
// meets a triangle. The corners are taken relative to x, so that no digits are lost. `towards` is -1 if x is a vertex
// of body a, 1 if of b.
vec3 ray_hit(ContactPatch contact_patch, vec3 x, uint triangle, float towards) {
    uvec3 corners = fetch(triangles, triangle).xyz;
    vec3 p = fetch(skin, corners.x).xyz - x, q = fetch(skin, corners.y).xyz - x,
         r = fetch(skin, corners.z).xyz - x;
    mat3 axes = mat3(contact_patch.tangent, contact_patch.bitangent, contact_patch.normal);
    vec3 a = p * axes, b = q * axes, c = r * axes;
    vec3 w = vec3(b.x * c.y - b.y * c.x, c.x * a.y - c.y * a.x, a.x * b.y - a.y * b.x);
    w /= w.x + w.y + w.z;
    return vec3(towards * (w.x * a.z + w.y * b.z + w.z * c.z), w.yz);
}

// Cosine of the angle between a vertex's and the contact's normal below which a vertex deeper than depth_limit is no
// contact.
const float GRAZING = 0.5;

shared uint listed[CHUNK_VERTICES];
shared uint listed_count;
shared uint colliding[SLOTS / 32];
shared uint totals[SIZE];
shared bool is_last;

// Lists the vertices of a chunk that have hits (with `all` every vertex), so that no lane is idle for a vertex without
// hits.
void list_vertices(ActiveChunk entry, Chunk chunk, bool all) {
    uint lane = gl_LocalInvocationID.x;
    if (lane == 0) listed_count = 0;
    for (uint k = lane; k < SLOTS / 32; k += SIZE) colliding[k] = 0;
    barrier();
    uint contact_patches = bitCount(entry.contact_patches);
    for (uint l = 4 * lane; l < chunk.vertex_count; l += 4 * SIZE) {
        bvec4 is_hit = bvec4(all);
        for (uint k = 0; k < contact_patches; k++) {
            uvec4 found = fetch(entry_hits, ((entry.first_work_item + k) * CHUNK_VERTICES + l) / 4);
            is_hit = bvec4(uvec4(is_hit) | uvec4(notEqual(found, uvec4(NONE))));
        }
        for (uint k = 0; k < 4; k++) {
            if (is_hit[k] && l + k < chunk.vertex_count) listed[atomicAdd(listed_count, 1)] = l + k;
        }
    }
    barrier();
}

void find_candidates(ActiveChunk entry, Chunk chunk, Pair pair) {
    bool side_b = (entry.side & 1) != 0;
    list_vertices(entry, chunk, pair.is_plane != 0);
    uint done = 0;
    for (uint k = gl_LocalInvocationID.x; k < listed_count; k += SIZE) {
        done++;
        uint l = listed[k], at = gl_WorkGroupID.x * SLOTS + l, v = chunk.vertex_first + l;
        uint vertex = fetch(chunk_vertices, v / 4)[v % 4];
        float weights[PAIR_PATCHES], depths[PAIR_PATCHES], strongest = 0.0;
        vec3 hit = vec3(0.0);
        uint triangle = NONE, opposing = 0;
        bool folded = false;
        for (uint r = 0; r < PAIR_PATCHES; r++) weights[r] = depths[r] = 0.0;
        if (!SKINS || pair.is_plane != 0) {
            hit.x = pair.plane.w - dot(pair.plane.xyz, fetch(skin, vertex).xyz);
            if (hit.x <= 0.0) continue;
            strongest = weights[0] = 1.0;
            depths[0] = hit.x;
        } else {
            uint work_item = entry.first_work_item;
            for (uint left = entry.contact_patches; left != 0; left &= left - 1) {
                uint r = findLSB(left);
                uint hash_entry = work_item * CHUNK_VERTICES + l;
                work_item += 1;
                bool through;
                uvec3 nearest = nearest_ray_hit(hash_entry, through);
                if (nearest.x == NONE || (nearest.y & 1) == 0) continue;
                ContactPatch contact_patch = contact_patch_at((entry.side / 2) * PAIR_PATCHES + r);
                vec3 found = ray_hit(contact_patch, fetch(skin, vertex).xyz, nearest.x, side_b ? 1.0 : -1.0);
                if (is_nan(found.x) || found.x <= 0.0) continue;
                depths[r] = found.x;
                weights[r] = fetch(shares, entry.pair_proxy)[r] / max(found.x * found.x, 1.0e-30);
                if (weights[r] > strongest) {
                    strongest = weights[r];
                    folded = through;
                    opposing = nearest.y >> 1;
                    hit = found;
                    triangle = nearest.x;
                }
            }
            if (strongest == 0.0) continue;
        }
        float all = 0.0, depth = 0.0;
        vec3 normal = vec3(0.0);
        for (uint r = 0; r < PAIR_PATCHES; r++) {
            float weight = weights[r] / strongest;
            weight *= BLEND ? smoothstep(0.5, 1.0, weight) : float(weight == 1.0);
            if (weight == 0.0) continue;
            all += weight;
            depth += weight * depths[r];
            normal += weight * contact_patch_at((entry.side / 2) * PAIR_PATCHES + r).normal;
        }
        depth /= all;
        // Where normals cancel, for a vertex between two opposite patches, no contact normal can be chosen.
        if (dot(normal, normal) <= 1.0e-6 * all * all) {
            atomicOr(counts.flags, FLAG_NOT_HEIGHT_FIELD);
            continue;
        }
        normal = normalize(normal);
        float sign = side_b ? -1.0 : 1.0;
        vec3 faced;
        vec3 outward = sign * outward_normal(vertex, sign * normal, faced);
        float facing = dot(outward, normal);
        bool alone = pair.is_plane != 0 || pair.lone_side != 0;
        float area = (alone ? 1.0 : 0.5) * facing * areas[vertex];
        if (area <= 0.0) continue;
        if (folded) atomicOr(counts.flags, FLAG_NOT_HEIGHT_FIELD);
        if (depth > params.depth_limit) {
            atomicOr(counts.flags, FLAG_DEPTH_LIMIT);
            // The shortest way out lies far off the ray, so this depth would give far too large a force.
            if (BLEND && facing < GRAZING) continue;
        }
        candidate_hits[at] = vec4(depth, hit.yz, area);
        atomicOr(colliding[l / 32], 1u << l % 32);
        candidate_what[at] = uvec4(vertex, entry.side, triangle, 0);
        candidate_normals[at] = vec4(normal, 1.0);
        uint proxy_pair = NONE;
        if (pair.is_plane == 0) {
            uint other = active_chunks[work_items[opposing].x].pair_proxy;
            uint a = (side_b ? other : entry.pair_proxy) - pair.first_pair_proxy[0];
            uint b = (side_b ? entry.pair_proxy : other) - pair.first_pair_proxy[1];
            proxy_pair = pair.first_proxy_pair + a * pair.proxy_count[1] + b;
        }
        // The push is depth times rest area times the normal, turned to point from a to b; culling uses it in the next
        // step. The walls beside the rim of a flat face do not count: seldom do as many vertices of one rim collide as
        // of the opposite one, so that they would tilt the contact normal.
        candidate_pushes[at] = uvec4(floatBitsToUint(depth * areas[vertex] * sign * faced), proxy_pair);
    }
    // If these numbers differ, the driver ended the loop early.
    if (done != (listed_count + SIZE - 1 - gl_LocalInvocationID.x) / SIZE) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}

// Makes candidates of the overlaps of the chunk's triangles. Several patches are blended as for vertices, with the mean
// depth in place of a vertex's.
void find_overlapping(ActiveChunk entry, Chunk chunk, Pair pair) {
    bool side_b = (entry.side & 1) != 0;
    for (uint k = gl_LocalInvocationID.x; k < SLOTS / 32; k += SIZE) colliding[k] = 0;
    barrier();
    for (uint l = gl_LocalInvocationID.x; l < chunk.triangle_count; l += SIZE) {
        float weights[PAIR_PATCHES], strongest = 0.0;
        uint places[PAIR_PATCHES];
        Overlap nearest;
        uint work_item = entry.first_work_item;
        for (uint r = 0; r < PAIR_PATCHES; r++) weights[r] = 0.0;
        for (uint left = entry.contact_patches; left != 0; left &= left - 1) {
            uint r = findLSB(left);
            places[r] = overlap_at[work_item++ * CHUNK_TRIANGLES + l];
            if (places[r] == NONE) continue;
            Overlap found = overlaps[places[r]];
            float depth = found.volume / found.area;
            weights[r] = fetch(shares, entry.pair_proxy)[r] / max(depth * depth, 1.0e-30);
            if (weights[r] > strongest) {
                strongest = weights[r];
                nearest = found;
            }
        }
        if (strongest == 0.0) continue;
        float all = 0.0, area = 0.0, volume = 0.0, stiff_volume = 0.0;
        vec3 normal = vec3(0.0), push = vec3(0.0);
        for (uint r = 0; r < PAIR_PATCHES; r++) {
            float weight = weights[r] / strongest;
            weight *= BLEND ? smoothstep(0.5, 1.0, weight) : float(weight == 1.0);
            if (weight == 0.0) continue;
            Overlap found = overlaps[places[r]];
            all += weight;
            area += weight * found.area;
            volume += weight * found.volume;
            stiff_volume += weight * found.stiffening * found.volume;
            push += weight * found.push;
            normal += weight * contact_patch_at((entry.side / 2) * PAIR_PATCHES + r).normal;
        }
        if (dot(normal, normal) <= 1.0e-6 * all * all) {
            atomicOr(counts.flags, FLAG_NOT_HEIGHT_FIELD);
            continue;
        }
        if (nearest.deepest > params.depth_limit) atomicOr(counts.flags, FLAG_DEPTH_LIMIT);
        uint at = gl_WorkGroupID.x * SLOTS + l, t = chunk.triangle_first + l;
        atomicOr(colliding[l / 32], 1u << l % 32);
        candidate_hits[at] = vec4(volume / area, nearest.barycentric, area / all);
        // The contact counts as one of the other body's vertex on the triangle.
        candidate_what[at] = uvec4(nearest.vertex, entry.side ^ 1, fetch(chunk_triangles, t / 4)[t % 4], 0);
        candidate_normals[at] = vec4(normalize(normal), stiff_volume / volume);
        // The other side has one proxy.
        uint own = entry.pair_proxy - pair.first_pair_proxy[side_b ? 1 : 0];
        uint proxy_pair = pair.first_proxy_pair + own * (side_b ? 1 : pair.proxy_count[1]);
        candidate_pushes[at] = uvec4(floatBitsToUint((side_b ? -1.0 : 1.0) / all * push), proxy_pair);
    }
}

// Lists all candidates that collide; each lane takes a contiguous run of the words of `chunk_contacts`.
void list_all() {
    uint lane = gl_LocalInvocationID.x, words = counts.gathering * (SLOTS / 32);
    uint run = (words + SIZE - 1) / SIZE;
    uint begin = min(lane * run, words), end = min(begin + run, words);
    uint own = 0;
    for (uint e = begin; e < end; e++) own += bitCount(chunk_contacts[e]);
    totals[lane] = own;
    barrier();
    uint at = 0, all = 0;
    for (uint k = 0; k < SIZE; k++) {
        if (k < lane) at += totals[k];
        all += totals[k];
    }
    bool fits = all <= CAPACITY;
    uint after = at + own;
    for (uint e = begin; e < end && fits; e++) {
        uint left = chunk_contacts[e];
        while (left != 0) {
            contact_source[at++] = 32 * e + findLSB(left);
            left &= left - 1;
        }
    }
    // If these numbers differ, the driver ended the loop early.
    if (fits && at != after) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    if (lane != 0) return;
    if (!fits) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    uint contacts = min(all, CAPACITY);
    counts.contacts = contacts;
    args[3 * ARGS_DEEPEST] = fits ? 0 : 1;
    args[3 * ARGS_CONTACTS] = groups_of(contacts);
}

void main() {
    ActiveChunk entry = active_chunks[gl_WorkGroupID.x];
    Chunk chunk = chunks[entry.chunk];
    Pair pair = pairs[entry.side / 2];
    if (OVERLAPS) {
        if (pair.by_triangles != 0) find_overlapping(entry, chunk, pair);
    }
    if (pair.by_triangles == 0) find_candidates(entry, chunk, pair);
    barrier();
    if (gl_LocalInvocationID.x == 0) {
        for (uint k = 0; k < SLOTS / 32; k++) chunk_contacts[gl_WorkGroupID.x * (SLOTS / 32) + k] = colliding[k];
    }
    memoryBarrierBuffer();
    if (gl_LocalInvocationID.x == 0) {
        is_last = atomicAdd(counts.chunks_asked, 1) == gl_NumWorkGroups.x - 1;
    }
    barrier();
    if (!is_last) return;
    memoryBarrierBuffer();
    list_all();
}
