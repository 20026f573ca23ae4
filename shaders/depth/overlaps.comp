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
// One workgroup runs for each work item, an active chunk in one patch (a chunk is a group of at most 64 skin vertices
// with their triangles). It appends an `Overlap` for each triangle of a chunk of the gathering skin that has one, and
// writes where it is. The f64 reference implementation is oracle::overlap.

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

// Cosine of the angle between a triangle's normal and the patch's below which the triangle is seen edge-on, and left
// out.
const float EDGE_ON = 0.001;
const uint AWAY = 0x80000000u;          // marks, in `other_vertex`, a triangle that faces away
const uint PAIRS = 64;                  // most pairs of triangles that are integrated at a time
// Mean depth, in units of the own body's thickness, from which on what lies behind the other body counts less, and at
// which it does not count at all.
const vec2 THIN = vec2(0.8, 1.2);
// How far rounding may move a point, as a share of its distance from the origin.
const float ROUNDING = 2.0e-7;

// The triangles of a chunk of the other skin: corners in the patch's plane and along its normal, first vertex.
shared vec2 other_places[3 * CHUNK_TRIANGLES];
shared float other_heights[3 * CHUNK_TRIANGLES];
shared uint other_vertex[CHUNK_TRIANGLES];
shared uint is_kept[SIZE];
shared uint own_listed[CHUNK_TRIANGLES];    // own triangles that may overlap that chunk
shared uint any_behind;                     // whether any own triangle lies behind the other body's far side
shared float other_stiffening[CHUNK_TRIANGLES];
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
// Distance from the centre of pressure to the own far side along the normal, m.
shared float thickness[CHUNK_TRIANGLES];

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

// Integrates over the overlap of the pair in place `i` of the list. `sign`: 1 if the own triangle is of a, -1 if of b.
void integrate(mat3 axes, Chunk chunk, uint i, float sign) {
    // A pair that an ended loop left unlisted must not reach beyond the arrays.
    uint l = min(listed[i] & 0xffffu, CHUNK_TRIANGLES - 1), k = min(listed[i] >> 16, CHUNK_TRIANGLES - 1);
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
    if ((other_vertex[k] & AWAY) != 0) {
        behind[l] += found.x;
        return;
    }
    float stiffening = stiffens_tips ? other_stiffening[k] : 1.0;
    sums[l] += vec4(found.xy, stiffening * found.zw);
    stiff_volumes[l] += stiffening * found.y;
    pushes[l] = vec4(pushes[l].xyz + push.xyz, max(pushes[l].w, push.w));
    if (found.y > greatest[l]) {
        greatest[l] = found.y;
        vertex_met[l] = other_vertex[k];
    }
}

// Box of own triangle `l` in the patch's plane. Returns how far the triangle reaches towards the other skin along the
// normal, m; very far back if it does not face the other skin.
float bound_own(mat3 axes, Chunk chunk, uint l, float sign, out vec2 low, out vec2 high) {
    vec3 p[3];
    vec2 base;
    relative_corners(axes, chunk, l, p, base);
    low = base + min(min(p[0].xy, p[1].xy), p[2].xy);
    high = base + max(max(p[0].xy, p[1].xy), p[2].xy);
    vec3 area = cross(p[1] - p[0], p[2] - p[0]);
    if (!(sign * area.z > EDGE_ON * length(area))) return -3.0e38;
    return max(sign * p[0].z, max(sign * p[1].z, sign * p[2].z));
}

// Lists the own triangles that may overlap a chunk of the other skin with these bounds, in their order, and returns
// their number.
uint list_own(mat3 axes, Chunk chunk, Slab bound, float sign) {
    uint lane = gl_LocalInvocationID.x, count = 0;
    for (uint first = 0; first < chunk.triangle_count; first += SIZE) {
        uint l = first + lane;
        bool keep = false;
        if (l < chunk.triangle_count) {
            vec2 low, high;
            float reach = bound_own(axes, chunk, l, sign, low, high);
            keep = reach >= sign * bound.extreme && all(lessThanEqual(low, bound.high))
                && all(greaterThanEqual(high, bound.low));
        }
        is_kept[lane] = keep ? 1 : 0;
        barrier();
        uint at = count;
        for (uint k = 0; k < SIZE; k++) {
            if (k < lane) at += is_kept[k];
            count += is_kept[k];
        }
        if (keep) own_listed[at] = l;
        barrier();
    }
    return count;
}

// How many of `count` elements this lane handles, where each lane handles every SIZE-th element.
uint turns_of(uint count) { return (count + SIZE - 1 - gl_LocalInvocationID.x) / SIZE; }

// Which of the `others` listed triangles own triangle `l` may overlap, one bit for each, and their number.
uint find_met(mat3 axes, Chunk chunk, uint l, uint others, float sign, out uint met[CHUNK_TRIANGLES / 32]) {
    for (uint word = 0; word < CHUNK_TRIANGLES / 32; word++) met[word] = 0;
    vec2 low, high;
    float reach = bound_own(axes, chunk, l, sign, low, high);
    uint count = 0;
    due += (others + 31) / 32;
    for (uint word = 0; 32 * word < others; word++) {
        done++;
        uint bits = 0;
        for (uint b = 0; b < 32; b++) {
            uint k = 32 * word + b;
            vec2 x = other_places[3 * k], y = other_places[3 * k + 1], z = other_places[3 * k + 2];
            // How far it reaches towards the own skin.
            float other_reach = max(-sign * other_heights[3 * k],
                max(-sign * other_heights[3 * k + 1], -sign * other_heights[3 * k + 2]));
            bool meets = k < others && all(lessThanEqual(min(min(x, y), z), high))
                && all(greaterThanEqual(max(max(x, y), z), low)) && reach + other_reach > 0.0;
            bits |= meets ? 1u << b : 0u;
        }
        met[word] = bits;
        count += bitCount(bits);
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

// Lists the triangles of a chunk that may overlap what lies in the box from `low` to `high`, and returns their number;
// with `away_alone` only those that face away from the other body. `side` is the side that does not have the chunk. The
// order is that of the chunk, so that sums do not depend on the device.
uint list_triangles(mat3 axes, Chunk chunk, uint side, vec2 low, vec2 high, bool away_alone) {
    uint lane = gl_LocalInvocationID.x, count = 0;
    for (uint first = 0; first < chunk.triangle_count; first += SIZE) {
        uint t = first + lane;
        bool keep = false;
        uvec4 triangle;
        vec3 corners[3];
        vec4 box;
        if (t < chunk.triangle_count) {
            uint at = chunk.triangle_first + t;
            corners_of(axes, fetch(chunk_triangles, at / 4)[at % 4], triangle, corners);
            box = vec4(min(min(corners[0].xy, corners[1].xy), corners[2].xy),
                max(max(corners[0].xy, corners[1].xy), corners[2].xy));
            vec3 area = cross(corners[1] - corners[0], corners[2] - corners[0]);
            keep = all(lessThanEqual(box.xy, high)) && all(greaterThanEqual(box.zw, low))
                && abs(area.z) > EDGE_ON * length(area);
            // The chunk is of b where `side` is a: its triangles face a with normals against n.
            bool away = (side == 0) == (area.z > 0.0);
            if (away) triangle.x |= AWAY;
            keep = keep && (away || !away_alone);
        }
        is_kept[lane] = keep ? 1 : 0;
        barrier();
        uint at = count;
        for (uint k = 0; k < SIZE; k++) {
            if (k < lane) at += is_kept[k];
            count += is_kept[k];
        }
        if (keep) {
            for (uint c = 0; c < 3; c++) {
                other_places[3 * at + c] = corners[c].xy;
                other_heights[3 * at + c] = corners[c].z;
            }
            other_vertex[at] = triangle.x;
            other_stiffening[at] = uintBitsToFloat(triangle.w);
        }
        barrier();
    }
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
        if (any(lessThan(bound.high, slab.low)) || any(greaterThan(bound.low, slab.high))) continue;
        uint behind_count = list_triangles(axes, chunks[other.chunk], 1 - side, slab.low, slab.high, true);
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
        sums[l] = pushes[l] = vec4(0.0);
        stiff_volumes[l] = behind[l] = greatest[l] = 0.0;
        thickness[l] = 3.0e38;
        vertex_met[l] = 0;
    }
    if (lane == 0) any_behind = 0;
    uvec2 range = work_items_of(pair, 1 - side);
    due += range.y - range.x;
    for (uint w = range.x; w < range.y; w++) {
        done++;
        if (work_items[w].y != work_item.y) continue;
        ActiveChunk other = active_chunks[work_items[w].x];
        Slab bound = slab_of(other, r);
        bool beside = any(lessThan(bound.high, slab.low)) || any(greaterThan(bound.low, slab.high));
        if (beside || sign * (slab.extreme - bound.extreme) < 0.0) continue;
        uint owns = list_own(axes, chunk, bound, sign);
        if (owns == 0) continue;
        uint others = list_triangles(axes, chunks[other.chunk], side, slab.low, slab.high, false);
        due += (owns + SIZE - 1) / SIZE;
        for (uint first = 0; first < owns; first += SIZE) {
            done++;
            uint l = 0, met[CHUNK_TRIANGLES / 32], count = 0;
            if (first + lane < owns) {
                l = own_listed[first + lane];
                count = find_met(axes, chunk, l, others, sign, met);
            }
            is_kept[lane] = count;
            barrier();
            uint begin = 0, all = 0;
            for (uint k = 0; k < SIZE; k++) {
                if (k < lane) begin += is_kept[k];
                all += is_kept[k];
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
                    add(l, listed[i] >> 16, i);
                }
                barrier();
            }
            barrier();
        }
    }
    barrier();
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
        if (behind[l] > 0.0 && sums[l].y > 0.0) atomicOr(any_behind, 1);
        else behind[l] = 0.0;
    }
    barrier();
    if (any_behind != 0) measure_thickness(axes, work_item, pair, side, chunk, slab);
    for (uint l = lane; l < chunk.triangle_count; l += SIZE) {
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
