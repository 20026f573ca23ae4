#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/args.glsl"

// Cull stage (broad phase) of a step: forms the contact patches (`ContactPatch`) of a pair of bodies a and b: columns
// of space in which they may touch, each with one contact normal. One workgroup runs for each pair of bodies. The f64
// reference implementation is oracle::contact_patches. A skin is the surface mesh of a body, a collision proxy a convex
// hull around part of a skin. A proxy pair is a proxy of a with a proxy of b; a pair proxy is one proxy in one pair of
// bodies. A chunk is a group of at most 64 skin vertices.
//
// A proxy pair has a direction, estimated from its two hulls and, once they touch, from the push (sum of depth x area x
// normal) of their contacts in the last step. These directions are clustered by similarity into at most PAIR_PATCHES
// clusters, by mean shift that starts at the strongest direction that no cluster has yet (Fukunaga and Hostetler 1975).
// Each cluster is a patch, whose normal is the weighted mean of the cluster's directions; the proxies of its proxy
// pairs are the patch's members. The share of a direction in a patch is smooth in directions and weights, and a patch's
// strength (weight of all its directions) grows from zero, so that nothing jumps when a patch appears. A proxy divides
// the weight of its vertices among the patches of its proxy pairs.
//
// The column of a patch is what its members of body a and its members of body b cover in common. All proxies of both
// bodies that lie in the column, and whose skin may reach the other body's skin along the normal, become active pair
// proxies. In `proxy_patches` each pair proxy has two bit masks of patches: those in whose column it is active (lowest
// PAIR_PATCHES bits), and those of which it is a member (the next PAIR_PATCHES bits).

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const float FOLLOW = 1.0;          // share of its rotation that a normal makes in one step
layout(constant_id = 1) const uint MOST_CELLS = 128;      // most cells of the spatial hash along a side of a patch

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar) readonly buffer Bounds { ProxyBounds bounds[]; };
READ_ONLY(vec4, hull);
READ_ONLY(vec4, directions);  // two per proxy pair: unit normal, weight; push of the last step's contacts, its length
layout(scalar) buffer ContactPatches { ContactPatch contact_patches[]; };
layout(scalar) writeonly buffer Shares { float shares[]; };  // weights of the patches at each pair proxy's vertices
layout(scalar) buffer Boxes { vec3 boxes[]; };  // least and greatest corners of PAIR_PATCHES boxes per pair proxy
layout(scalar) coherent buffer ProxyPatches { uint proxy_patches[]; };  // masks: in a patch's column, member of a patch
layout(scalar) writeonly buffer PairProxyCounts { uvec2 pair_proxy_counts[]; };
layout(scalar) writeonly buffer ActivePairProxies { uint active_pair_proxies[]; };  // pair proxies in a column
layout(scalar) writeonly buffer DepthGrids { uint depth_grids[]; };  // min-max depth grids of chunks (cleared here)
layout(scalar) buffer CountsInOut { Counts counts; };
layout(scalar) buffer Args { uint args[]; };
layout(scalar) coherent buffer NearPairs { uint near_pairs[]; };  // proxy pairs with a direction, in order

#include "shared/sum.glsl"
#include "shared/depth_grid.glsl"

// Cosine of the angle between two directions above which they are fully similar.
const float ALIKE = 0.7071;
// Cosine of the angle between two directions below which they are not similar at all.
const float UNLIKE = 0.2588;
const uint SHIFTS = 4;          // rounds of mean shift for each patch
// A cluster whose directions have at most this weight forms no patch. The weights of all directions sum to at least 1
// and less than 2.
const float LEAST_STRENGTH = 1.0e-3;
// Least weight of a patch at the vertices of its members.
const float LEAST_SHARE = 1.0e-4;
// A patch that has the share s of the strength of all patches has at least the weight GUEST_SHARE (s - GUESTS_FROM) at
// the vertices of proxies that are not its members.
const float GUEST_SHARE = 0.05;
// Share of the strength of all patches up to which a patch has no weight at the vertices of proxies that are not its
// members, because such a weak patch may rest on directions estimated from hulls alone, which are too uncertain.
const float GUESTS_FROM = 0.1;
// Share of a proxy pair's direction that must belong to a patch for the pair's two proxies to be members of the patch.
const float LEAST_PART = 0.01;

// Strength above which a patch's normal was found from contacts, not from hulls alone.
const float TOLD = 0.1;
// Weight in a patch's normal of a direction that is estimated from hulls, relative to one found from contacts.
const float GUESS = 0.01;
// Total push (depth x area) of contacts at which contacts have half their full weight, in units of e^3. e is the
// greater of two mean edge lengths, those of the skin that each body's first proxy covers.
const float LEAST_PUSH = 0.1;

shared vec3 low[SIZE];
shared vec3 high[SIZE];
shared vec4 strongest[SIZE];
shared uint is_near[SIZE];

vec3 normals[PAIR_PATCHES];
float strength[PAIR_PATCHES];
uint patch_count = 0;
vec4 before[PAIR_PATCHES];      // the last step's normals and strengths
float all_weights, all_pushes, least_push;      // sums of weights and pushes of proxy pairs; LEAST_PUSH in m^3
uint near_count = 0;

// Direction of a proxy pair.
struct Direction {
    vec3 normal;      // unit, from a to b
    float push;       // weight in the mean normal of a patch
    float weight;     // weight in the decision whether a patch exists
};

// Combines the direction that is estimated from the hulls of a proxy pair with the push of the pair's contacts. Returns
// false if the hulls are too far apart to touch.
bool direction_of(uint proxy_pair, out Direction direction) {
    vec4 guess = fetch(directions, 2 * proxy_pair);
    if (guess.w <= 0.0) return false;
    // Weights are divided by their sums before they are combined, so that none is large enough to overflow.
    guess.w /= all_weights;
    vec4 push = fetch(directions, 2 * proxy_pair + 1) / (all_pushes + least_push);
    vec3 sum = push.xyz + GUESS * guess.w * guess.xyz;
    float size = length(sum);
    direction = Direction(size > 0.0 ? sum / size : guess.xyz, push.w + GUESS * guess.w, push.w + guess.w);
    return true;
}

// Lists the proxy pairs that have a direction, in the order of their indices.
void list_near(Pair pair) {
    uint lane = gl_LocalInvocationID.x;
    for (uint first = 0; first < pair.proxy_pair_count; first += SIZE) {
        uint k = pair.first_proxy_pair + first + lane;
        bool near = first + lane < pair.proxy_pair_count && fetch(directions, 2 * k).w > 0.0;
        is_near[lane] = near ? 1 : 0;
        barrier();
        uint place = near_count;
        for (uint l = 0; l < SIZE; l++) {
            if (l < lane) place += is_near[l];
            near_count += is_near[l];
        }
        if (near) near_pairs[pair.first_proxy_pair + place] = k;
        barrier();
    }
    memoryBarrierBuffer();
    barrier();
}

// Similarity of two directions, 0 to 1.
float alike(vec3 n, vec3 m) { return smoothstep(UNLIKE, ALIKE, dot(n, m)); }

// Share of a direction that belongs to none of the first `count` patches.
float remainder(vec3 n, uint count) {
    float left = 1.0;
    for (uint r = 0; r < count; r++) left *= 1.0 - alike(n, normals[r]);
    return left;
}

// Share of a direction that belongs to patch r.
float part(vec3 n, uint r) {
    float all = 0.0;
    for (uint q = 0; q < patch_count; q++) all += strength[q] * alike(n, normals[q]);
    return all > 0.0 ? strength[r] * alike(n, normals[r]) / all : 0.0;
}

// The direction with the greatest weight left over by the first `count` patches, and that weight.
vec4 strongest_remainder(Pair pair, uint count) {
    uint lane = gl_LocalInvocationID.x;
    vec4 best = vec4(0.0, 1.0, 0.0, 0.0);
    for (uint k = lane; k < near_count; k += SIZE) {
        Direction direction;
        if (!direction_of(near_pairs[pair.first_proxy_pair + k], direction)) continue;
        float left = direction.weight * remainder(direction.normal, count);
        if (left > best.w) best = vec4(direction.normal, left);
    }
    strongest[lane] = best;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width && strongest[lane + width].w > strongest[lane].w) strongest[lane] = strongest[lane + width];
    }
    barrier();
    best = strongest[0];
    barrier();
    return best;
}

// The normal of a patch whose directions have the mean n. If a normal near n was found from contacts in the last step,
// it makes only the share FOLLOW of the rotation to n: contacts respond one step late, and with long steps the whole
// rotation would overshoot.
vec3 followed(vec3 n) {
    vec3 last = vec3(0.0);
    float cosine = ALIKE;
    for (uint q = 0; q < PAIR_PATCHES; q++) {
        if (before[q].w < TOLD || dot(before[q].xyz, n) < cosine) continue;
        last = before[q].xyz;
        cosine = dot(last, n);
    }
    return last == vec3(0.0) ? n : normalize(mix(last, n, FOLLOW));
}

// Finds the patches, their normals and strengths; raises FLAG_PATCH_OVERFLOW if directions are left over.
void find_normals(Pair pair) {
    uint lane = gl_LocalInvocationID.x;
    for (uint r = 0; r < PAIR_PATCHES; r++) {
        vec4 seed = strongest_remainder(pair, r);
        if (seed.w <= 0.0) return;
        vec3 n = seed.xyz;
        float weights = 0.0, pushes = 0.0;
        for (uint round = 0; round < SHIFTS; round++) {
            vec4 sum = vec4(0.0);
            float weight = 0.0;
            for (uint k = lane; k < near_count; k += SIZE) {
                Direction direction;
                if (!direction_of(near_pairs[pair.first_proxy_pair + k], direction)) continue;
                float own = remainder(direction.normal, r) * alike(direction.normal, n);
                sum += own * direction.push * vec4(direction.normal, 1.0);
                weight += own * direction.weight;
            }
            sum = workgroup_sum(sum);
            weights = workgroup_sum(vec4(weight)).x;
            pushes = sum.w;
            if (dot(sum.xyz, sum.xyz) > 0.0) n = normalize(sum.xyz);
        }
        if (weights <= LEAST_STRENGTH) return;
        strength[r] = pushes * (1.0 - LEAST_STRENGTH / weights);
        normals[r] = followed(n);
        patch_count = r + 1;
    }
    float left = 0.0;
    for (uint k = lane; k < near_count; k += SIZE) {
        Direction direction;
        if (!direction_of(near_pairs[pair.first_proxy_pair + k], direction)) continue;
        left += direction.weight * remainder(direction.normal, patch_count);
    }
    left = workgroup_sum(vec4(left)).x;
    if (left > LEAST_STRENGTH && lane == 0) atomicOr(counts.flags, FLAG_PATCH_OVERFLOW);
}

// Writes for each pair proxy the weight of each patch at its vertices, and in the upper bits of `proxy_patches` the
// patches of which it is a member.
void share_out(Pair pair) {
    uint a_count = pair.proxy_count[0], b_count = pair.proxy_count[1];
    for (uint s = gl_LocalInvocationID.x; s < a_count + b_count; s += SIZE) {
        float share[PAIR_PATCHES];
        for (uint r = 0; r < PAIR_PATCHES; r++) share[r] = 0.0;
        bool of_a = s < a_count, near = false;
        uint members = 0;
        uint first = pair.first_proxy_pair + (of_a ? s * b_count : s - a_count);
        uint count = of_a ? b_count : a_count, stride = of_a ? 1 : b_count;
        for (uint k = 0; k < count; k++) {
            Direction direction;
            if (!direction_of(first + k * stride, direction)) continue;
            near = true;
            for (uint r = 0; r < patch_count; r++) {
                float own = pair.direction.w != 0.0 ? 1.0 : part(direction.normal, r);
                share[r] += direction.push * own;
                if (own >= LEAST_PART) members |= 1u << r;
            }
        }
        float sum = 0.0, all = 0.0;
        for (uint r = 0; r < patch_count; r++) {
            sum += share[r];
            all += strength[r];
        }
        uint pair_proxy = pair_proxy_of(pair, s);
        for (uint r = 0; r < PAIR_PATCHES; r++) {
            float own = (members & (1u << r)) != 0 ? max(LEAST_SHARE, share[r] / sum) : 0.0;
            // A strong patch also has weight at the vertices of proxies that are not its members: their shortest way
            // out of the other body may be along its normal.
            if (near && r < patch_count) own = max(own, GUEST_SHARE * max(0.0, strength[r] / all - GUESTS_FROM));
            shares[pair_proxy * PAIR_PATCHES + r] = own;
        }
        proxy_patches[pair_proxy] = members << PAIR_PATCHES;
        pair_proxy_counts[pair_proxy] = uvec2(0);
    }
    memoryBarrierBuffer();
    barrier();
}

// Box, along the patch's axes, of a proxy's hull, inflated by how far skin may lie outside it; unless `exact`, a larger
// box, around the proxy's bounds in world axes.
void hull_box(uint id, mat3 axes, bool exact, out vec3 least, out vec3 greatest) {
    Proxy proxy = proxies[id];
    float inflation = bounds[id].inflation;
    if (!exact) {
        vec3 centre = 0.5 * (bounds[id].low + bounds[id].high), half_extent = 0.5 * (bounds[id].high - bounds[id].low);
        mat3 absolute = mat3(abs(axes[0]), abs(axes[1]), abs(axes[2]));
        least = centre * axes - half_extent * absolute - inflation;
        greatest = centre * axes + half_extent * absolute + inflation;
        return;
    }
    least = vec3(3.0e38);
    greatest = vec3(-3.0e38);
    for (uint k = 0; k < proxy.hull_count; k++) {
        vec3 x = fetch(hull, proxy.hull_first + k).xyz * axes;
        least = min(least, x - inflation);
        greatest = max(greatest, x + inflation);
    }
}

// Empties the depth grids of a patch's chunks.
void clear_grids(uint contact_patch, uint lane) {
    for (uint k = lane; k < GRID * GRID; k += SIZE) {
        depth_grids[grid_first(contact_patch, 0) + k] = 0;
        depth_grids[grid_first(contact_patch, 1) + k] = NONE;
    }
}

// Replaces a lane's box by the box around the boxes of all lanes.
void cover(inout vec3 least, inout vec3 greatest) {
    uint lane = gl_LocalInvocationID.x;
    low[lane] = least;
    high[lane] = greatest;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) {
            low[lane] = min(low[lane], low[lane + width]);
            high[lane] = max(high[lane], high[lane + width]);
        }
    }
    barrier();
    least = low[0];
    greatest = high[0];
    barrier();
}

// Two tangents that turn smoothly with the normal n, and n (Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited").
mat3 axes_of(vec3 n) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Writes patch r: the boxes of its pair proxies, its column, and which pair proxies are in the column.
void open_contact_patch(Pair pair, uint r, uint first_patch) {
    uint lane = gl_LocalInvocationID.x;
    uint member = 1u << PAIR_PATCHES + r;
    mat3 axes = axes_of(normals[r]);
    vec3 side_low[2], side_high[2];
    float edge[2];
    for (uint side = 0; side < 2; side++) {
        uint begin = pair.first_pair_proxy[side];
        vec3 least = vec3(3.0e38), greatest = vec3(-3.0e38);
        vec4 edges = vec4(0.0);
        for (uint p = lane; p < pair.proxy_count[side]; p += SIZE) {
            if ((proxy_patches[begin + p] & member) == 0) continue;
            vec3 box_low, box_high;
            hull_box(pair.first_proxy[side] + p, axes, true, box_low, box_high);
            boxes[2 * ((begin + p) * PAIR_PATCHES + r)] = box_low;
            boxes[2 * ((begin + p) * PAIR_PATCHES + r) + 1] = box_high;
            least = min(least, box_low);
            greatest = max(greatest, box_high);
            edges.xy += vec2(proxies[pair.first_proxy[side] + p].edge, 1.0);
        }
        cover(least, greatest);
        edges = workgroup_sum(edges);
        side_low[side] = least;
        side_high[side] = greatest;
        edge[side] = edges.x / max(edges.y, 1.0);
    }
    vec2 column_low = max(side_low[0].xy, side_low[1].xy), column_high = min(side_high[0].xy, side_high[1].xy);
    bool touches = all(lessThanEqual(column_low, column_high)) && side_high[0].z >= side_low[1].z;
    for (uint side = 0; side < 2; side++) {
        uint begin = pair.first_pair_proxy[side];
        for (uint p = lane; p < pair.proxy_count[side]; p += SIZE) {
            uint pair_proxy = begin + p;
            bool near = (proxy_patches[pair_proxy] & member) != 0;
            uint box = 2 * (pair_proxy * PAIR_PATCHES + r);
            vec3 box_low = boxes[box], box_high = boxes[box + 1];
            if (!near) hull_box(pair.first_proxy[side] + p, axes, false, box_low, box_high);
            bool within = touches && all(lessThanEqual(box_low.xy, column_high))
                && all(greaterThanEqual(box_high.xy, column_low))
                && (side == 0 ? box_high.z >= side_low[1].z : box_low.z <= side_high[0].z);
            if (within) proxy_patches[pair_proxy] |= 1u << r;
            if (within && !near) {
                boxes[2 * (pair_proxy * PAIR_PATCHES + r)] = box_low;
                boxes[2 * (pair_proxy * PAIR_PATCHES + r) + 1] = box_high;
            }
        }
    }
    clear_grids(first_patch + r, lane);
    if (lane != 0) return;
    vec2 extent = column_high - column_low;
    float finest = max(max(extent.x, extent.y) / float(MOST_CELLS), 1.0e-9);
    if (params.texel > 0.0 && params.texel < finest) atomicOr(counts.flags, FLAG_PATCH_OVERFLOW);
    float cells_per_metre[2];
    for (uint side = 0; side < 2; side++) {
        // The hash gets two or three cells for each vertex, unless a triangle of the other side then covers many cells.
        float wanted = params.texel > 0.0 ? params.texel : max(0.6 * edge[side], edge[1 - side] / 6.0);
        cells_per_metre[side] = 1.0 / max(wanted, finest);
    }
    // The rotation since the last step is measured from the last step's normal nearest to this one, because the patches
    // may have another order now.
    float turn = 0.0, cosine = -1.0;
    for (uint q = 0; q < PAIR_PATCHES; q++) {
        if (before[q].w > 0.0) cosine = max(cosine, dot(before[q].xyz, normals[r]));
    }
    if (cosine > -1.0) turn = acos(min(cosine, 1.0));
    // A rotation before the skins touch does not count, because the direction is then only an estimate.
    if (touches && all_pushes >= least_push) atomicMax(counts.turn, floatBitsToUint(turn));
    contact_patches[first_patch + r] =
        ContactPatch(normals[r], axes[0], axes[1], column_low, column_high, cells_per_metre,
            touches ? strength[r] : 0.0, turn, float[3](0.0, 0.0, 0.0));
}

// Writes the one patch of a skin and a half-space, and activates the pair proxies that may reach below the half-space's
// plane.
void open_plane(Pair pair, uint first_patch) {
    uint lane = gl_LocalInvocationID.x;
    mat3 axes = axes_of(-pair.plane.xyz);
    for (uint p = lane; p < pair.proxy_count[0]; p += SIZE) {
        uint pair_proxy = pair.first_pair_proxy[0] + p;
        vec3 box_low, box_high;
        hull_box(pair.first_proxy[0] + p, axes, true, box_low, box_high);
        bool within = box_high.z >= -pair.plane.w;
        for (uint r = 0; r < PAIR_PATCHES; r++) shares[pair_proxy * PAIR_PATCHES + r] = within && r == 0 ? 1.0 : 0.0;
        proxy_patches[pair_proxy] = within ? 1 : 0;
        pair_proxy_counts[pair_proxy] = uvec2(0);
    }
    if (lane == 0) {
        contact_patches[first_patch] =
            ContactPatch(axes[2], axes[0], axes[1], vec2(0.0), vec2(0.0), float[2](1.0, 1.0), 1.0, 0.0,
                float[3](0.0, 0.0, 0.0));
    }
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    Pair pair = pairs[gl_WorkGroupID.x];
    uint first_patch = gl_WorkGroupID.x * PAIR_PATCHES;
    for (uint r = 0; r < PAIR_PATCHES; r++) {
        before[r] = vec4(contact_patches[first_patch + r].normal, contact_patches[first_patch + r].weight);
    }
    barrier();
    if (pair.is_plane != 0) {
        patch_count = 1;
        open_plane(pair, first_patch);
    } else {
        list_near(pair);
        vec4 sums = vec4(0.0);
        for (uint k = lane; k < near_count; k += SIZE) {
            uint at = 2 * near_pairs[pair.first_proxy_pair + k];
            sums.xy += vec2(fetch(directions, at).w, fetch(directions, at + 1).w);
        }
        sums = workgroup_sum(sums);
        all_weights = sums.x;
        all_pushes = sums.y;
        float edge = max(proxies[pair.first_proxy[0]].edge, proxies[pair.first_proxy[1]].edge);
        least_push = LEAST_PUSH * edge * edge * edge;
        if (all_weights > 0.0 && pair.direction.w != 0.0) {
            normals[0] = pair.direction.xyz;
            strength[0] = 1.0;
            patch_count = 1;
        } else if (all_weights > 0.0) {
            find_normals(pair);
        }
        share_out(pair);
        for (uint r = 0; r < patch_count; r++) open_contact_patch(pair, r, first_patch);
    }
    for (uint r = patch_count + lane; r < PAIR_PATCHES; r += SIZE) contact_patches[first_patch + r].weight = 0.0;
    memoryBarrierBuffer();
    barrier();
    uint pair_proxies = pair.proxy_count[0] + (pair.is_plane != 0 ? 0 : pair.proxy_count[1]);
    for (uint s = lane; s < pair_proxies; s += SIZE) {
        uint pair_proxy = pair_proxy_of(pair, s);
        if ((proxy_patches[pair_proxy] & ((1u << PAIR_PATCHES) - 1u)) != 0) {
            active_pair_proxies[atomicAdd(args[3 * ARGS_CHUNKS], 1)] = pair_proxy;
        }
    }
}
