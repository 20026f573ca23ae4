#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/depth_grid.glsl"

// Depth stage (narrow phase) of a step, for pairs of bodies whose contacts are found by triangles (`by_triangles` of
// `Pair`): integrates the penetration depth over each triangle of the gathering skin (surface mesh). A contact patch is
// a column of space in which bodies a and b may touch, with a normal n from a to b; seen along n, the depth at a point
// of a triangle is the height of a's skin there minus that of b's, which is linear where one triangle of a and one of b
// overlap. With A the part of their overlap in which the depth d is positive, the integrals over all triangles of the
// other skin are
//
//     area = sum |A|,    volume = sum integral of d over A,    moment = sum integral of d x over A,
//
// with x the place in the patch's plane. So the net force of a penalty pressure k d is k volume, at the centre of
// pressure moment / volume, exactly, however coarse or fine either skin is. Where triangles of the other skin belong to
// a tip or an edge, k is greater by their stiffening (src/stages/tips.rs); force and moment are then sums of these
// products, and the overlap has the mean stiffening, weighted by volume. A is convex, and the integrals over it are
// sums over the segments of its boundary, which lies on the edges of both triangles and the line where d is zero.
// Triangles of the other skin that face away bound it on its far side. What lies behind them is outside the other body,
// and is no contact if the other body is also behind the own far side, as it is under an overhang of the own body. If
// it is not, the other body is a thin one that lies wholly within the own, and is pushed out as any other.
//
// One workgroup runs for each work item of a gathering skin: an active chunk in one patch. A chunk is a group of at
// most 64 skin vertices with their triangles. The workgroup lists the chunks of the other skin that may overlap its
// own, then the own triangles that may overlap any of those, and takes chunk after chunk: the triangles that meet
// listed ones, and the pairs of triangles, which all lanes integrate. It appends an `Overlap` for each own triangle
// that has one, and writes where it is. The f64 reference implementation is oracle::overlap.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint PAIR_PROXIES = 1;
layout(constant_id = 2) const uint MOST_OVERLAPS = 1;       // room for overlaps; more raise FLAG_CONTACT_OVERFLOW

layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) readonly buffer WorkItems { uvec2 work_items[]; };  // active chunk and contact patch of each item
layout(scalar) readonly buffer ActiveChunks { ActiveChunk active_chunks[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, chunk_triangles);      // triangles of chunks, four per texel
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
layout(scalar) readonly buffer PairProxies { PairProxy pair_proxies[]; };
layout(scalar) readonly buffer PairProxyCounts { uvec2 pair_proxy_counts[]; };   // chunks, work items before each
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar) readonly buffer Slabs { Slab slabs[]; };     // bounds of chunks, PAIR_PATCHES per chunk of a pair proxy
layout(scalar) readonly buffer ContactPatches { ContactPatch contact_patches[]; };
READ_ONLY(uvec4, triangles);            // three skin vertices, stiffening (bits of a float)
READ_ONLY(vec4, skin);
layout(scalar) writeonly buffer Overlaps { Overlap overlaps[]; };
layout(scalar) writeonly buffer OverlapAt { uint overlap_at[]; };   // CHUNK_TRIANGLES for each work item: overlap, or NONE

#include "shared/turns.glsl"

// Cosine of the angle between a triangle's normal and the patch's below which the triangle is seen edge-on, and left
// out.
const float EDGE_ON = 0.001;
const uint AWAY = 0x80000000u;          // marks, in `other_triangle`, a triangle that faces away
const uint PAIRS = 64;                  // most pairs of triangles that are integrated at a time
const uint OWNS = 32;                   // own triangles that are tested at a time, a bit of a word for each
const uint LISTED = 64;                 // chunks of the other skin that are looked at at a time
// Mean depth, in units of the own body's thickness, from which on what lies behind the other body counts less, and at
// which it does not count at all.
const vec2 THIN = vec2(0.8, 1.2);
// How far rounding may move a point, as a share of its distance from the origin.
const float ROUNDING = 2.0e-7;

// Triangles of a chunk of the other skin: corners in the patch's plane and along its normal, place in `triangles`.
shared vec2 other_places[3 * CHUNK_TRIANGLES];
shared float other_heights[3 * CHUNK_TRIANGLES];
shared uint other_triangle[CHUNK_TRIANGLES];
shared uint other_meets[CHUNK_TRIANGLES];   // own triangles that it may overlap, one bit for each
shared uint flagged[(SIZE + 31) / 32];      // one bit for each lane, for `place_of`
shared uint pair_counts[OWNS];              // number of pairs of each lane's own triangle
shared uint own_listed[CHUNK_TRIANGLES];    // own triangles that may overlap the other skin
// At most OWNS of the listed own triangles are tested at a time. For each of these:
shared vec4 own_box[OWNS];                  // its box in the patch's plane: low and high corner, m
shared float own_reach[OWNS];               // how far it reaches towards the other skin along the normal, m
shared uint met_items[LISTED];              // work items of chunks of the other skin that may overlap the own chunk
shared uint met_bits[LISTED / 32];          // one bit for each chunk that is looked at: whether it is among these
shared uint near_owns[LISTED];              // own triangles that may overlap each of these, one bit for each triangle
shared uint others_bound[5];                // keys of the bounds of `list_others`
shared uint any_behind;                     // whether any own triangle lies behind the other body's far side
// Pairs of an own triangle and one of the other chunk (own in the lower half, other in the upper half of a word), and
// their integrals. All lanes integrate, whichever own triangles have pairs, and the own triangles' lanes add in order.
shared uint listed[PAIRS];
shared vec4 pair_sums[PAIRS];               // area, volume, moment
shared vec4 pair_pushes[PAIRS];             // push along the patch's axes, greatest depth
// The sums of the own triangles.
shared vec4 sums[CHUNK_TRIANGLES];          // area, volume, moment times stiffening
shared float stiff_volumes[CHUNK_TRIANGLES];    // volume times stiffening, m^3
shared vec4 pushes[CHUNK_TRIANGLES];        // push along the patch's axes, greatest depth
shared uint vertex_met[CHUNK_TRIANGLES];    // vertex of the other skin where `greatest` is
shared float behind[CHUNK_TRIANGLES];       // area behind the far side of the other body, m^2
shared float greatest[CHUNK_TRIANGLES];     // greatest volume with one triangle of the other skin, m^3

// Rounds of its loops that this lane has to do, and those that it did: drivers may end loops early
// (docs/evidence/benchmarks.md, "Two traps").
uint due, done;
bool stiffens_tips;                         // of the pair

// Corners of a triangle along the patch's axes, m. `found`: its element of `triangles`.
void corners_of(mat3 axes, uint triangle, out uvec4 found, out vec3 corners[3]) {
    found = fetch(triangles, triangle);
    for (uint k = 0; k < 3; k++) corners[k] = fetch(skin, found[k]).xyz * axes;
}

float cross2(vec2 p, vec2 q) { return p.x * q.y - p.y * q.x; }

// Height of the plane through a corner with an area vector above the origin of the patch's plane, and its slopes along
// the tangents.
vec3 plane_of(vec3 corner, vec3 area) {
    vec2 slope = -area.xy / area.z;
    return vec3(corner.z - dot(slope, corner.xy), slope);
}

// Shortens the part of a segment from t.x to t.y, as shares of its length, to where a linear function, given at both
// ends of the segment, is not negative.
void cut(inout vec2 t, float at_start, float at_end) {
    float zero = at_start / (at_start - at_end);
    if (at_start < 0.0) t.x = at_end < 0.0 ? 2.0 : max(t.x, zero);
    else if (at_end < 0.0) t.y = min(t.y, zero);
}

// Integrals over the overlap of two triangles: area, volume, and moment about a point of the boundary; greatest depth.
struct Integrals {
    float area, volume, deepest;
    vec2 moment, about;
    bool has_point;
};

// Adds the part of the boundary on a segment: the signed triangle of `about` and that part, over which the depth, given
// as a plane, is integrated. Over the whole boundary the signed triangles add up to what it encloses. With a point of
// the boundary in place of any other, small gaps between its segments have no lever.
void add_boundary(inout Integrals sums, vec2 from, vec2 to, vec2 t, vec3 depth) {
    if (t.x >= t.y) return;
    vec2 p = mix(from, to, t.x), q = mix(from, to, t.y);
    if (!sums.has_point) sums.about = p;
    sums.has_point = true;
    float at_about = depth.x + dot(depth.yz, sums.about);
    float at_p = depth.x + dot(depth.yz, p), at_q = depth.x + dot(depth.yz, q), sum = at_about + at_p + at_q;
    p -= sums.about;
    q -= sums.about;
    float area = 0.5 * cross2(p, q);
    sums.area += area;
    sums.volume += area * sum / 3.0;
    sums.moment += area / 12.0 * (sum * (p + q) + at_p * p + at_q * q);
    sums.deepest = max(sums.deepest, max(at_p, at_q));
}

// How far inside the edge from `from` along `along` a point lies, times the edge's length.
float inside(vec2 from, vec2 along, vec2 at) { return cross2(along, at - from); }

// Integrals over the part of two triangles' overlap in which the depth, a plane, is positive. The corners are given
// counter-clockwise. The part is convex; its boundary lies on edges of p, edges of q and the line of no depth. Where an
// edge of p and one of q lie on each other, the edge of p counts: edges of q must lie inside p by more than `rounding`
// (m), while edges of p may lie outside q by as much.
Integrals overlap(vec2 p[3], vec2 q[3], vec3 depth, float rounding) {
    Integrals sums = Integrals(0.0, 0.0, 0.0, vec2(0.0), vec2(0.0), false);
    vec2 p_along[3], q_along[3];
    float p_depth[3], q_depth[3];
    for (uint k = 0; k < 3; k++) {
        p_along[k] = p[(k + 1) % 3] - p[k];
        q_along[k] = q[(k + 1) % 3] - q[k];
        p_depth[k] = depth.x + dot(depth.yz, p[k]);
        q_depth[k] = depth.x + dot(depth.yz, q[k]);
    }
    float p_margin[3], q_margin[3];
    for (uint k = 0; k < 3; k++) {
        p_margin[k] = rounding * length(p_along[k]);
        q_margin[k] = rounding * length(q_along[k]);
    }
    for (uint k = 0; k < 3; k++) {
        uint next = (k + 1) % 3;
        vec2 of_p = vec2(0.0, 1.0), of_q = vec2(0.0, 1.0);
        for (uint edge = 0; edge < 3; edge++) {
            cut(of_p, inside(q[edge], q_along[edge], p[k]) + q_margin[edge],
                inside(q[edge], q_along[edge], p[next]) + q_margin[edge]);
            cut(of_q, inside(p[edge], p_along[edge], q[k]) - p_margin[edge],
                inside(p[edge], p_along[edge], q[next]) - p_margin[edge]);
        }
        cut(of_p, p_depth[k], p_depth[next]);
        cut(of_q, q_depth[k], q_depth[next]);
        add_boundary(sums, p[k], p[next], of_p, depth);
        add_boundary(sums, q[k], q[next], of_q, depth);
    }
    float slope2 = dot(depth.yz, depth.yz);
    if (slope2 > 0.0) {
        // A segment of the line of no depth that is long enough to cross both triangles.
        vec2 middle = (p[0] + p[1] + p[2]) / 3.0, along = vec2(depth.z, -depth.y) * inversesqrt(slope2);
        middle -= (depth.x + dot(depth.yz, middle)) / slope2 * depth.yz;
        float reach = 2.0 * (length(p_along[0]) + length(p_along[1]));
        vec2 from = middle - reach * along, to = middle + reach * along, t = vec2(0.0, 1.0);
        for (uint edge = 0; edge < 3; edge++) {
            cut(t, inside(p[edge], p_along[edge], from) - p_margin[edge],
                inside(p[edge], p_along[edge], to) - p_margin[edge]);
            cut(t, inside(q[edge], q_along[edge], from) - q_margin[edge],
                inside(q[edge], q_along[edge], to) - q_margin[edge]);
        }
        add_boundary(sums, from, to, t, depth);
    }
    return sums;
}

// Corners of own triangle `l`, relative to the first of them in the patch's plane, which is `base`.
void relative_corners(mat3 axes, Chunk chunk, uint l, out vec3 p[3], out vec2 base) {
    uint at = chunk.triangle_first + l;
    uvec4 triangle;
    corners_of(axes, fetch(chunk_triangles, at / 4)[at % 4], triangle, p);
    base = p[0].xy;
    for (uint c = 0; c < 3; c++) p[c].xy -= base;
}

// The own and the other triangle of the pair in place `i` of the list. A pair that an ended loop left unlisted must not
// reach beyond the arrays.
uvec2 pair_at(uint i) { return min(uvec2(listed[i] & 0xffffu, listed[i] >> 16), uvec2(CHUNK_TRIANGLES - 1)); }

// Integrates over the overlap of the pair in place `i` of the list. `sign`: 1 if the own triangle is of a, -1 if of b.
void integrate(mat3 axes, Chunk chunk, uint i, float sign) {
    uint l = pair_at(i).x, k = pair_at(i).y;
    vec3 p[3], q[3];
    vec2 base;
    relative_corners(axes, chunk, l, p, base);
    for (uint c = 0; c < 3; c++) q[c] = vec3(other_places[3 * k + c] - base, other_heights[3 * k + c]);
    vec3 own_area = cross(p[1] - p[0], p[2] - p[0]), other_area = cross(q[1] - q[0], q[2] - q[0]);
    vec3 depth = sign * (plane_of(p[0], own_area) - plane_of(q[0], other_area));
    bool is_turned = other_area.z < 0.0;
    vec2 own_corners[3] = vec2[](p[0].xy, sign < 0.0 ? p[2].xy : p[1].xy, sign < 0.0 ? p[1].xy : p[2].xy);
    vec2 other_corners[3] = vec2[](q[0].xy, is_turned ? q[2].xy : q[1].xy, is_turned ? q[1].xy : q[2].xy);
    float place = length(base) + length(p[1].xy) + length(p[2].xy);
    Integrals found = overlap(own_corners, other_corners, depth, ROUNDING * place);
    found.volume = max(found.volume, 0.0);
    pair_sums[i] = vec4(found.area, found.volume, found.moment + found.volume * found.about);
    // The push goes along the normal of what faces the other: of a wall and a face that lies on it, along the face's.
    vec3 own = normalize(own_area), other = normalize(other_area);
    vec2 flat_share = vec2(own.z * own.z, other.z * other.z);
    vec3 mean = flat_share.x * flat_share.x * own - flat_share.y * flat_share.y * other;
    pair_pushes[i] = vec4(found.volume * normalize(mean), found.deepest);
}

// Adds the pair in place `i` of the list, which is of own triangle `l` and triangle `k` of the other chunk.
void add(uint l, uint k, uint i) {
    vec4 found = pair_sums[i], push = pair_pushes[i];
    if (!(found.x > 0.0)) return;
    if ((other_triangle[k] & AWAY) != 0) {
        behind[l] += found.x;
        return;
    }
    uvec4 triangle = fetch(triangles, other_triangle[k]);
    float stiffening = stiffens_tips ? uintBitsToFloat(triangle.w) : 1.0;
    sums[l] += vec4(found.xy, stiffening * found.zw);
    stiff_volumes[l] += stiffening * found.y;
    pushes[l] = vec4(pushes[l].xyz + push.xyz, max(pushes[l].w, push.w));
    if (found.y > greatest[l]) {
        greatest[l] = found.y;
        vertex_met[l] = triangle.x;
    }
}

// The place of this lane's element in a list of those that are kept, which has `count` elements so far; all lanes' are
// added to `count`.
uint place_of(bool keep, inout uint count) {
    uint lane = gl_LocalInvocationID.x, at = count;
    barrier();
    for (uint word = lane; word < flagged.length(); word += SIZE) flagged[word] = 0;
    barrier();
    if (keep) atomicOr(flagged[lane / 32], 1u << lane % 32);
    barrier();
    uint word = 0;
    do {
        uint below = 32 * word > lane ? 0 : 32 * word + 32 <= lane ? 0xffffffffu : (1u << lane % 32) - 1;
        at += bitCount(flagged[word] & below);
        count += bitCount(flagged[word]);
    } while (++word < flagged.length());
    return at;
}

// Box of own triangle `l` in the patch's plane. Returns how far the triangle reaches towards the other skin along the
// normal, m; very far back if it does not face the other skin.
float bound_own(mat3 axes, Chunk chunk, uint l, float sign, out vec4 box) {
    vec3 p[3];
    vec2 base;
    relative_corners(axes, chunk, l, p, base);
    box = vec4(base + min(min(p[0].xy, p[1].xy), p[2].xy), base + max(max(p[0].xy, p[1].xy), p[2].xy));
    vec3 area = cross(p[1] - p[0], p[2] - p[0]);
    if (!(sign * area.z > EDGE_ON * length(area))) return -3.0e38;
    return max(sign * p[0].z, max(sign * p[1].z, sign * p[2].z));
}

vec4 box_of(Slab slab) { return vec4(slab.low, slab.high); }

bool apart(vec4 a, vec4 b) { return any(lessThan(a.zw, b.xy)) || any(greaterThan(a.xy, b.zw)); }

// Greatest value of a plane over a box in the patch's plane.
float greatest_of(vec3 plane, vec4 box) {
    return plane.z + dot(plane.xy, mix(box.xy, box.zw, greaterThan(plane.xy, vec2(0.0))));
}

// How far rounding may move a plane within a box, m.
float rounding_of(vec3 plane, vec4 box) {
    return 8.0 * ROUNDING * (abs(plane.z) + dot(abs(plane.xy), max(abs(box.xy), abs(box.zw))));
}

// The part that two boxes have in common.
vec4 common_box(vec4 a, vec4 b) { return vec4(max(a.xy, b.xy), min(a.zw, b.zw)); }

// Whether an own triangle with such a box and reach may overlap a chunk of the other skin with these bounds.
bool may_meet(vec4 box, float reach, Slab other, float sign) {
    vec4 other_box = box_of(other);
    vec4 common_part = common_box(box, other_box);
    vec3 plane = -sign * other.plane;
    return !apart(box, other_box) && reach >= sign * other.extreme
        && reach + greatest_of(plane, common_part) + rounding_of(plane, common_part) >= 0.0;
}

// Whether a chunk of the own skin and one of the other may overlap.
bool chunks_meet(Slab own, Slab other, float sign) {
    vec4 common_part = common_box(box_of(own), box_of(other));
    vec3 between = sign * (own.plane - other.plane);
    return !apart(box_of(own), box_of(other)) && sign * (own.extreme - other.extreme) >= 0.0
        && greatest_of(between, common_part) + rounding_of(own.plane, common_part)
            + rounding_of(other.plane, common_part) >= 0.0;
}

// Lists the own triangles that may overlap what lies in the box `others` in the patch's plane and reaches as far as
// `extreme` along the normal, in their order, and returns their number. The first OWNS of them are tested next.
uint list_own(mat3 axes, Chunk chunk, vec4 others, float extreme, float sign) {
    uint lane = gl_LocalInvocationID.x, count = 0;
    due += (chunk.triangle_count + SIZE - 1) / SIZE;
    for (uint first = 0; first < chunk.triangle_count; first += SIZE) {
        done++;
        uint l = first + lane;
        bool keep = false;
        vec4 box;
        float reach;
        if (l < chunk.triangle_count) {
            reach = bound_own(axes, chunk, l, sign, box);
            keep = reach >= sign * extreme && !apart(box, others);
        }
        uint at = place_of(keep, count);
        if (keep) {
            own_listed[at] = l;
            if (at < OWNS) {
                own_box[at] = box;
                own_reach[at] = reach;
            }
        }
    }
    barrier();
    return count;
}

// Which of the `owns` own triangles that are tested may overlap a chunk of the other skin, one bit for each.
uint owns_near(uint owns, Slab other, float sign) {
    uint near = 0;
    due += owns;
    for (uint j = 0; j < owns; j++) {
        done++;
        near |= may_meet(own_box[j], own_reach[j], other, sign) ? 1u << j : 0u;
    }
    return near;
}

// Which of the own triangles `near` a triangle of the other skin may overlap; `reach`: how far it reaches towards the
// own skin along the normal, m.
uint owns_met(uint near, vec4 box, float reach) {
    uint met = 0;
    due += bitCount(near);
    for (uint rest = near; rest != 0; rest &= rest - 1) {
        done++;
        uint j = findLSB(rest);
        met |= !apart(own_box[j], box) && own_reach[j] + reach > 0.0 ? 1u << j : 0u;
    }
    return met;
}

// The place of the set bit of `bits` with `before` set bits below it.
uint set_bit(uint bits, uint before) {
    due += before;
    for (uint n = 0; n < before; n++) {
        done++;
        bits &= bits - 1;
    }
    return findLSB(bits);
}

// Which of the `others` listed triangles the own triangle of bit `j` may overlap, one bit for each, and their number.
uint find_met(uint j, uint others, out uint met[CHUNK_TRIANGLES / 32]) {
    for (uint word = 0; word < CHUNK_TRIANGLES / 32; word++) met[word] = 0;
    uint count = 0;
    due += others;
    for (uint k = 0; k < others; k++) {
        done++;
        uint bit = other_meets[k] >> j & 1u;
        met[k / 32] |= bit << k % 32;
        count += bit;
    }
    return count;
}

// The index of the next set bit, which is cleared.
uint take(inout uint met[CHUNK_TRIANGLES / 32]) {
    uint word = 0;
    while (word < CHUNK_TRIANGLES / 32 - 1 && met[word] == 0) word++;
    uint k = 32 * word + findLSB(met[word]);
    met[word] &= met[word] - 1;
    return k;
}

// Lists triangles of a chunk and returns their number: those that may overlap any of the own triangles `near`, or if
// there are none, those that face away from the other body within the box `limits`. `side` is the side that does not
// have the chunk. The order is that of the chunk, so that sums do not depend on the device.
uint list_triangles(mat3 axes, Chunk chunk, uint side, vec4 limits, uint near) {
    uint lane = gl_LocalInvocationID.x, count = 0;
    due += (chunk.triangle_count + SIZE - 1) / SIZE;
    for (uint first = 0; first < chunk.triangle_count; first += SIZE) {
        done++;
        uint t = first + lane, id = 0, met = 0;
        bool keep = false;
        vec3 corners[3];
        if (t < chunk.triangle_count) {
            uint at = chunk.triangle_first + t;
            id = fetch(chunk_triangles, at / 4)[at % 4];
            uvec4 triangle;
            corners_of(axes, id, triangle, corners);
            vec4 box = vec4(min(min(corners[0].xy, corners[1].xy), corners[2].xy),
                max(max(corners[0].xy, corners[1].xy), corners[2].xy));
            vec3 area = cross(corners[1] - corners[0], corners[2] - corners[0]);
            // The chunk is of b where `side` is a: its triangles face a with normals against n.
            bool away = (side == 0) == (area.z > 0.0);
            if (away) id |= AWAY;
            vec3 heights = vec3(corners[0].z, corners[1].z, corners[2].z) * (side == 0 ? -1.0 : 1.0);
            met = owns_met(near, box, max(max(heights.x, heights.y), heights.z));
            keep = !apart(box, limits) && abs(area.z) > EDGE_ON * length(area) && (near == 0 ? away : met != 0);
        }
        uint at = place_of(keep, count);
        if (keep) {
            for (uint c = 0; c < 3; c++) {
                other_places[3 * at + c] = corners[c].xy;
                other_heights[3 * at + c] = corners[c].z;
            }
            other_triangle[at] = id;
            other_meets[at] = met;
        }
    }
    barrier();
    return count;
}

Slab slab_of(ActiveChunk entry, uint r) {
    PairProxy pair_proxy = pair_proxies[entry.pair_proxy];
    uint k = entry.chunk - proxies[pair_proxy.proxy].chunk_first;
    return slabs[(pair_proxy.chunk_first + k) * PAIR_PATCHES + r];
}

// Range of the work items of a side of a pair.
uvec2 work_items_of(Pair pair, uint side) {
    uint begin = pair.first_pair_proxy[side], end = begin + pair.proxy_count[side];
    uvec2 range = uvec2(pair_proxy_counts[begin].y, end < PAIR_PROXIES ? pair_proxy_counts[end].y : counts.work_items);
    // There may be more work items than fit.
    return min(range, uvec2(counts.work_items));
}

// The centre of pressure of own triangle `l` in the patch's plane, relative to its first corner.
vec2 centre_of(uint l) { return sums[l].zw / stiff_volumes[l]; }

// Distance from an own triangle's centre of pressure to the own far side along the normal, m; takes the place of
// `greatest` when all sums are known.
#define thickness greatest

// Finds how thick the own body is at the centres of pressure of triangles that lie behind the other body's far side.
void measure_thickness(mat3 axes, uvec2 work_item, Pair pair, uint side, Chunk chunk, Slab slab) {
    uint lane = gl_LocalInvocationID.x;
    float sign = side == 0 ? 1.0 : -1.0;
    uvec2 range = work_items_of(pair, side);
    due += range.y - range.x;
    for (uint w = range.x; w < range.y; w++) {
        done++;
        if (work_items[w].y != work_item.y) continue;
        ActiveChunk other = active_chunks[work_items[w].x];
        Slab bound = slab_of(other, work_item.y % PAIR_PATCHES);
        if (apart(box_of(bound), box_of(slab))) continue;
        uint behind_count = list_triangles(axes, chunks[other.chunk], 1 - side, box_of(slab), 0);
        due += turns_of(chunk.triangle_count);
        for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
            done++;
            if (behind[l] == 0.0) continue;
            uint at = chunk.triangle_first + l;
            uvec4 triangle;
            vec3 p[3];
            corners_of(axes, fetch(chunk_triangles, at / 4)[at % 4], triangle, p);
            vec2 x = p[0].xy + centre_of(l);
            vec3 own = plane_of(p[0], cross(p[1] - p[0], p[2] - p[0]));
            due += behind_count;
            for (uint k = 0; k < behind_count; k++) {
                done++;
                vec3 q[3];
                for (uint c = 0; c < 3; c++) q[c] = vec3(other_places[3 * k + c], other_heights[3 * k + c]);
                vec3 area = cross(q[1] - q[0], q[2] - q[0]);
                bool meets = true;
                for (uint c = 0; c < 3; c++) {
                    meets = meets && inside(q[c].xy, q[(c + 1) % 3].xy - q[c].xy, x) * area.z >= 0.0;
                }
                vec3 between = own - plane_of(q[0], area);
                float gap = sign * (between.x + dot(between.yz, x));
                if (meets && gap > 0.0) thickness[l] = min(thickness[l], gap);
            }
        }
        barrier();
    }
}

// Lists those of the chunks of the other side with work items from `first` to `end`, LISTED of them at most, that may
// overlap the own chunk in contact patch `patch_index`, and returns their number. `box`: their box in the patch's
// plane; `extreme`: how far they reach along the normal.
uint list_others(uint first, uint end, uint patch_index, Slab own, float sign, out vec4 box, out float extreme) {
    uint lane = gl_LocalInvocationID.x, items = min(LISTED, end - first);
    barrier();
    for (uint k = lane; k < 5; k += SIZE) others_bound[k] = 0xffffffffu;
    for (uint word = lane; word < LISTED / 32; word += SIZE) met_bits[word] = 0;
    barrier();
    due += turns_of(items);
    for (uint k = lane; k < items; k += SIZE) {
        done++;
        uvec2 item = work_items[first + k];
        if (item.y != patch_index) continue;
        Slab bound = slab_of(active_chunks[item.x], patch_index % PAIR_PATCHES);
        if (!chunks_meet(own, bound, sign)) continue;
        atomicOr(met_bits[k / 32], 1u << k % 32);
        atomicMin(others_bound[0], height_key(bound.low.x));
        atomicMin(others_bound[1], height_key(bound.low.y));
        atomicMin(others_bound[2], height_key(-bound.high.x));
        atomicMin(others_bound[3], height_key(-bound.high.y));
        atomicMin(others_bound[4], height_key(sign * bound.extreme));
    }
    barrier();
    uint count = 0;
    for (uint word = 0; word < LISTED / 32; word++) {
        uint bits = met_bits[word];
        for (uint bit = lane; bit < 32; bit += SIZE) {
            if ((bits >> bit & 1) != 0) met_items[count + bitCount(bits & ((1u << bit) - 1))] = first + 32 * word + bit;
        }
        count += bitCount(bits);
    }
    barrier();
    box = vec4(height_of_key(others_bound[0]), height_of_key(others_bound[1]), -height_of_key(others_bound[2]),
        -height_of_key(others_bound[3]));
    extreme = sign * height_of_key(others_bound[4]);
    return count;
}

// Integrates over the overlaps of own triangles with the triangles of a chunk of the other skin. `first_own`: the place
// in `own_listed` of the first of those that are tested; `near`: which of those may overlap that chunk.
void integrate_chunk(mat3 axes, Chunk chunk, Chunk other, Slab slab, uint side, uint first_own, uint near) {
    uint lane = gl_LocalInvocationID.x;
    float sign = side == 0 ? 1.0 : -1.0;
    uint others = list_triangles(axes, other, side, box_of(slab), near), owns = bitCount(near);
    due += (owns + SIZE - 1) / SIZE;
    for (uint first = 0; first < owns; first += SIZE) {
        done++;
        uint l = 0, met[CHUNK_TRIANGLES / 32], count = 0;
        if (first + lane < owns) {
            uint j = set_bit(near, first + lane);
            l = min(own_listed[first_own + j], CHUNK_TRIANGLES - 1);
            count = find_met(j, others, met);
        }
        if (first + lane < owns) pair_counts[lane] = count;
        barrier();
        uint begin = 0, all = 0;
        due += min(SIZE, owns - first);
        for (uint k = 0; k < min(SIZE, owns - first); k++) {
            done++;
            if (k < lane) begin += pair_counts[k];
            all += pair_counts[k];
        }
        // The lane's pairs have the places from `begin` on among all pairs of this round.
        due += 2 * count + (all + PAIRS - 1) / PAIRS;
        for (uint window = 0; window < all; window += PAIRS) {
            done++;
            uint size = min(PAIRS, all - window);
            uint low = clamp(begin, window, window + size) - window;
            uint high = clamp(begin + count, window, window + size) - window;
            for (uint i = low; i < high; i++) {
                done++;
                listed[i] = l | take(met) << 16;
            }
            barrier();
            due += turns_of(size);
            for (uint i = lane; i < size; i += SIZE) {
                done++;
                integrate(axes, chunk, i, sign);
            }
            barrier();
            for (uint i = low; i < high; i++) {
                done++;
                add(pair_at(i).x, pair_at(i).y, i);
            }
            barrier();
        }
        barrier();
    }
}

// Integrates over the overlaps of `owns` listed own triangles, from place `first_own` on, with the triangles of the
// `met` listed chunks of the other skin. `r`: number of the patch in its pair.
void integrate_owns(mat3 axes, Chunk chunk, Slab slab, uint side, uint r, uint met, uint first_own, uint owns) {
    uint lane = gl_LocalInvocationID.x;
    float sign = side == 0 ? 1.0 : -1.0;
    if (first_own > 0) {
        barrier();
        due += turns_of(owns);
        for (uint j = lane; j < owns; j += SIZE) {
            done++;
            uint l = min(own_listed[first_own + j], chunk.triangle_count - 1);
            own_reach[j] = bound_own(axes, chunk, l, sign, own_box[j]);
        }
        barrier();
    }
    due += turns_of(met);
    for (uint k = lane; k < met; k += SIZE) {
        done++;
        near_owns[k] = owns_near(owns, slab_of(active_chunks[work_items[met_items[k]].x], r), sign);
    }
    barrier();
    due += met;
    for (uint k = 0; k < met; k++) {
        done++;
        if (near_owns[k] == 0) continue;
        Chunk other = chunks[active_chunks[work_items[met_items[k]].x].chunk];
        integrate_chunk(axes, chunk, other, slab, side, first_own, near_owns[k]);
    }
}

void clear_sums(Chunk chunk) {
    uint lane = gl_LocalInvocationID.x;
    due += turns_of(chunk.triangle_count);
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
        done++;
        sums[l] = pushes[l] = vec4(0.0);
        stiff_volumes[l] = behind[l] = greatest[l] = 0.0;
        vertex_met[l] = 0;
    }
    if (lane == 0) any_behind = 0;
    barrier();
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uvec2 work_item = work_items[gl_WorkGroupID.x];
    ActiveChunk entry = active_chunks[work_item.x];
    uint side = entry.side & 1, r = work_item.y % PAIR_PATCHES;
    Pair pair = pairs[entry.side / 2];
    if (pair.by_triangles == 0 || !gathers(pair, side)) return;
    Chunk chunk = chunks[entry.chunk];
    ContactPatch contact_patch = contact_patches[work_item.y];
    mat3 axes = mat3(contact_patch.tangent, contact_patch.bitangent, contact_patch.normal);
    Slab slab = slab_of(entry, r);
    float sign = side == 0 ? 1.0 : -1.0;
    stiffens_tips = pair.stiffens_tips != 0;
    due = turns_of(chunk.triangle_count);
    done = 0;
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
        done++;
        overlap_at[gl_WorkGroupID.x * CHUNK_TRIANGLES + l] = NONE;
    }
    uvec2 range = work_items_of(pair, 1 - side);
    bool any_met = false;
    due += (range.y - range.x + LISTED - 1) / LISTED;
    for (uint first = range.x; first < range.y; first += LISTED) {
        done++;
        vec4 others;
        float extreme;
        uint met = list_others(first, range.y, work_item.y, slab, sign, others, extreme);
        uint listed_owns = met > 0 ? list_own(axes, chunk, others, extreme, sign) : 0;
        if (listed_owns == 0) continue;
        if (!any_met) clear_sums(chunk);
        any_met = true;
        due += (listed_owns + OWNS - 1) / OWNS;
        for (uint own = 0; own < listed_owns; own += OWNS) {
            done++;
            integrate_owns(axes, chunk, slab, side, r, met, own, min(OWNS, listed_owns - own));
        }
    }
    if (!any_met) {
        if (done != due) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
        return;
    }
    barrier();
    due += 2 * turns_of(chunk.triangle_count);
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
        done++;
        thickness[l] = 3.0e38;
        if (behind[l] > 0.0 && sums[l].y > 0.0) atomicOr(any_behind, 1);
        else behind[l] = 0.0;
    }
    barrier();
    if (any_behind != 0) measure_thickness(axes, work_item, pair, side, chunk, slab);
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
        done++;
        vec4 sum = sums[l];
        if (!(sum.y > 0.0)) continue;
        // How far the mean depth is beyond the own far side, smoothly, so that the force does not jump.
        float thin = smoothstep(THIN.x, THIN.y, sum.y / sum.x / thickness[l]);
        float share = 1.0 - thin * min(behind[l] / sum.x, 1.0);
        if (share <= 0.0) continue;
        // The centre of pressure as weights of the own triangle's second and third corner.
        uint at = chunk.triangle_first + l;
        uvec4 triangle;
        vec3 p[3];
        corners_of(axes, fetch(chunk_triangles, at / 4)[at % 4], triangle, p);
        vec2 x = centre_of(l), second = p[1].xy - p[0].xy, third = p[2].xy - p[0].xy;
        vec2 weights = vec2(cross2(x, third), cross2(second, x)) / cross2(second, third);
        uint place = atomicAdd(counts.overlaps, 1);
        bool fits = place < MOST_OVERLAPS;
        if (!fits) {
            atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
            continue;
        }
        overlap_at[gl_WorkGroupID.x * CHUNK_TRIANGLES + l] = place;
        overlaps[place] = Overlap(share * sum.x, share * sum.y, weights,
            share * (axes * pushes[l].xyz), pushes[l].w, stiff_volumes[l] / sum.y, vertex_met[l]);
    }
    if (done != due) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
