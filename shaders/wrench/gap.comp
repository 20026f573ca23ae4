#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/rotation.glsl"

// Wrench: finds the shortest way from the tool (rigid body that the haptic device leads) to the skins (surface meshes)
// that it may touch, at the end of the step. The kernel runs only for a haptic loop, which lets the user feel a wall at
// the end of this way until the next step is done. Skin is placed by the new displacements and by the frames at the end
// of the step. One workgroup runs for each part of skin, which is some chunks (groups of at most 64 skin vertices) of
// one collision proxy (convex hull around part of a skin), and writes SECTORS times a SkinGap. The f64 reference is
// oracle::gap.
//
// For a spherical tool the way runs from the tool's centre to a triangle of the skin. Besides the shortest way, in each of
// 26 sectors of directions of normals, along the world's axes, the nearest triangle that faces the tool is found, and the
// way to its plane, since a tool in a hollow may meet another place of the skin than the nearest one. A triangle faces
// the tool where the way to it is nearly along its normal. Of triangles whose way is longer than the shortest of the part
// by more than MARGIN, some are missed. For any other tool it is the shortest way between a vertex of one of the two
// surfaces and a triangle of the other; vertices of both surfaces are tested, as for contacts. For triangles that face
// away from the tool only the least distance is kept: where this distance is less than the length of the way, the tool
// is within a body. Among equally long ways the one with the lower index of its triangle counts; if their triangle is
// the same, the one with the lower index of its vertex.
//
// The chunks of a part are visited in the order of lower bounds of their distance, until no bound is below the length
// of the shortest way found plus MARGIN. A bound is the distance to the chunk's box at rest, moved by the middle of the
// range of the displacements of the chunk's nodes, and grown by half that range times the greatest sum of absolute
// embedding weights of a vertex. The positions of visited vertices are stored in `skin`, relative to the tool's centre
// along the tool's axes. A frame is a rigid coordinate frame, a link the relative placement of two frames.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint RIGIDS = 1;         // rigid bodies among the solver's unknowns; the tool is the last
layout(constant_id = 2) const bool SPANS = false;       // whether a skin vertex may have nodes in several frames
layout(constant_id = 3) const uint SHARE = 64;          // greatest number of chunks of a part
layout(constant_id = 4) const bool ROUND = false;       // whether the tool is a sphere
layout(constant_id = 5) const float RADIUS = 0.0;       // radius of a sphere about its centre that contains the tool, m
layout(constant_id = 6) const float REACH = 0.0;        // length of the longest way that is sought, m
layout(constant_id = 7) const uint TOOL_FRAME = 0;
layout(constant_id = 8) const uint TOOL_CHUNK_FIRST = 0;
layout(constant_id = 9) const uint TOOL_CHUNKS = 0;
layout(constant_id = 10) const uint SECTORS = 1;        // 27 for a sphere, 1 for others; one of them is for the shortest way
layout(constant_id = 11) const float MARGIN = 0.0;      // m; 0 with one sector

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) readonly buffer Parts { SkinPart parts[]; };
layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar) readonly buffer Chunks { Chunk chunks[]; };
READ_ONLY(uvec4, proxy_nodes);        // two nodes per texel, each with the link from the proxy's frame to its own
READ_ONLY(uvec4, chunk_nodes);        // two nodes per texel, each with the link from the proxy's frame to its own
READ_ONLY(uvec4, chunk_vertices);     // skin vertices of chunks, four per texel
READ_ONLY(uvec4, chunk_triangles);    // triangles of chunks, four per texel
READ_ONLY(uvec4, triangles);
READ_ONLY(uvec4, skin_nodes);     // the four nodes of each skin vertex; the first is NONE for a rigid skin
READ_ONLY(vec4, skin_weights);    // the four nodes' weights; for a rigid skin the position in the frame, m
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_info);      // z: index of the node's frame
layout(scalar) readonly buffer Links { Link links[]; };
layout(scalar) coherent buffer Skin { vec4 skin[]; };
layout(scalar) writeonly buffer Gaps { SkinGap gaps[]; };

#include "shared/settle.glsl"

// Length by which lower bounds of distances are reduced, m. It exceeds their rounding, so that no equally long way is
// missed.
const float SLACK = 1.0e-6;

struct Place {
    vec4 rotation;
    vec3 centre;
};

// A way from the tool to a skin.
struct Way {
    vec3 along;         // vector to the skin, from a spherical tool's centre or from another tool's surface, m
    float size;         // length of the way to the triangle, m
    uint triangle, vertex;      // index of the triangle and of the vertex at its ends
};

shared float bounds[SHARE];
shared vec3 middles[SHARE];
shared vec3 spreads[SHARE];
shared float partial[SIZE];
shared Way ways[SIZE];
shared uint known;      // a bit for each sector in which an invocation found a way

// The tool's rotation at the end of the step, and the ways that this invocation found, one for each sector.
vec4 tool_turn;
Way fronts[SECTORS];
uint found = 0;

float[6] change_of(uint rigid) { return iterates[solve.current * RIGIDS + rigid].x; }

// Placement of a frame at the end of the step, as solve/commit computes it.
Place end_of(Frame frame) {
    if (frame.core == NONE) {
        vec4 back = vec4(-frame.turn.xyz, frame.turn.w);
        return Place(compose(frame.rotation, back), frame.centre + params.dt * frame.linear);
    }
    float x[6] = change_of(frame.core);
    vec4 turn = turn_by(params.dt * (frame.angular + vec3(x[3], x[4], x[5])));
    return Place(compose(turn, frame.rotation), frame.centre + params.dt * (frame.linear + vec3(x[0], x[1], x[2])));
}

Place tool_at_end() {
    float x[6] = change_of(RIGIDS - 1), v[6] = params.tool_twist;
    for (int k = 0; k < 6; k++) x[k] = params.dt * (v[k] + x[k]);
    vec4 turn = turn_by(vec3(x[3], x[4], x[5]));
    return Place(compose(turn, frames[TOOL_FRAME].rotation), params.tool_centre + vec3(x[0], x[1], x[2]));
}

vec3 node_position(uint node) { return fetch(node_rest, node).xyz + fetch(displacement, node).xyz; }

vec3 world(uint node) {
    Place place = end_of(frames[fetch(node_info, node).z]);
    return place.centre + rotate(place.rotation, node_position(node));
}

// Position of a skin vertex at the end of the step, from the tool's centre along the tool's axes, m.
vec3 position(Place place, Place tool, uint vertex) {
    uvec4 nodes = fetch(skin_nodes, vertex);
    vec4 weights = fetch(skin_weights, vertex);
    vec3 x;
    if (SPANS && nodes.x != NONE) {
        x = weights.x * world(nodes.x) + weights.y * world(nodes.y) + weights.z * world(nodes.z)
            + weights.w * world(nodes.w);
    } else {
        vec3 local = weights.xyz;
        if (nodes.x != NONE) {
            local = weights.x * node_position(nodes.x) + weights.y * node_position(nodes.y)
                + weights.z * node_position(nodes.z) + weights.w * node_position(nodes.w);
        }
        x = place.centre + rotate(place.rotation, local);
    }
    return rotate_back(tool.rotation, x - tool.centre);
}

// Displacement of a node at the end of the step, in the frame of the proxy that lists the node. `links` holds the links
// as they were at the start of the step.
vec3 moved(uvec2 node, Frame start, Place place) {
    vec3 d = fetch(displacement, node.x).xyz;
    if (!SPANS || node.y == 0) return d;
    Frame own = frames[fetch(node_info, node.x).z];
    vec3 apart = rotate_back(start.rotation, own.centre - start.centre) - links[node.y].offset;
    return rotate_back(place.rotation, world(node.x) - place.centre) - apart - fetch(node_rest, node.x).xyz;
}

// Distance of a point from a box that is centred at the origin.
float box_distance(vec3 x, vec3 half_extent) { return length(max(abs(x) - half_extent, vec3(0.0))); }

// Square of the largest displacement (m^2) among those nodes of a proxy that this lane visits.
float largest_move2(Proxy proxy, Frame start, Place place) {
    float largest = 0.0;
    for (uint i = proxy.node_first / 2 + gl_LocalInvocationID.x; 2 * i < proxy.node_first + proxy.node_count; i += SIZE) {
        uvec4 two = fetch(proxy_nodes, i);
        vec3 d = moved(two.xy, start, place), e = moved(two.zw, start, place);
        largest = max(largest, max(dot(d, d), dot(e, e)));
    }
    return largest;
}

float workgroup_min(float value) {
    uint lane = gl_LocalInvocationID.x;
    partial[lane] = value;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) partial[lane] = min(partial[lane], partial[lane + width]);
    }
    barrier();
    float least = partial[0];
    barrier();
    return least;
}

// Middle of the range of displacements of a chunk's nodes, and bound on how far displacements of the chunk's skin lie
// from this middle, along each axis of the proxy's frame, m.
void spread_of(Chunk chunk, Frame start, Place place, out vec3 middle, out vec3 spread) {
    middle = vec3(0.0);
    spread = vec3(0.0);
    if (chunk.node_count == 0) return;
    vec3 least = vec3(GAP_FAR), greatest = vec3(-GAP_FAR);
    for (uint k = chunk.node_first; k < chunk.node_first + chunk.node_count; k += 2) {
        uvec4 two = fetch(chunk_nodes, k / 2);
        vec3 d = moved(two.xy, start, place), e = moved(two.zw, start, place);
        least = min(least, min(d, e));
        greatest = max(greatest, max(d, e));
    }
    middle = 0.5 * (least + greatest);
    // The factor 1.001 covers rounding.
    spread = 1.001 * chunk.weight_bound * 0.5 * (greatest - least);
}

// Lower bound of the distance of a point from a chunk's skin.
float chunk_distance(Chunk chunk, vec3 middle, vec3 spread, Place place, vec3 x) {
    vec3 at = rotate_back(place.rotation, x - place.centre) - chunk.centre - middle;
    vec3 third = cross(chunk.axes[0], chunk.axes[1]);
    vec3 along = vec3(dot(chunk.axes[0], at), dot(chunk.axes[1], at), dot(third, at));
    vec3 grown = vec3(dot(abs(chunk.axes[0]), spread), dot(abs(chunk.axes[1]), spread), dot(abs(third), spread));
    return box_distance(along, chunk.half_extent + grown) - SLACK;
}

// Centre of a sphere that contains a chunk of the tool; ball_radius gives the sphere's radius.
vec3 ball_centre(uint k, Place tool) { return tool.centre + rotate(tool.rotation, chunks[TOOL_CHUNK_FIRST + k].centre); }
float ball_radius(uint k) { return length(chunks[TOOL_CHUNK_FIRST + k].half_extent); }

// Lower bound of the distance of the tool from a chunk's skin.
float chunk_bound(Chunk chunk, vec3 middle, vec3 spread, Place place, Place tool) {
    if (ROUND) return chunk_distance(chunk, middle, spread, place, tool.centre);
    float least = GAP_FAR;
    for (uint k = 0; k < TOOL_CHUNKS; k++) {
        least = min(least, chunk_distance(chunk, middle, spread, place, ball_centre(k, tool)) - ball_radius(k));
    }
    return least;
}

// Point of an edge that is nearest to the origin.
vec3 nearest_of_edge(vec3 a, vec3 b) {
    vec3 ab = b - a;
    return a + clamp(-dot(a, ab) / max(dot(ab, ab), 1.0e-30), 0.0, 1.0) * ab;
}

// Point of a triangle that is nearest to the origin; n is along its normal.
vec3 nearest_of_triangle(vec3 a, vec3 b, vec3 c, vec3 n) {
    float square = dot(n, n);
    if (square > 0.0 && dot(cross(a, b), n) >= 0.0 && dot(cross(b, c), n) >= 0.0 && dot(cross(c, a), n) >= 0.0) {
        return dot(a, n) / square * n;
    }
    vec3 x = nearest_of_edge(a, b), y = nearest_of_edge(b, c), z = nearest_of_edge(c, a);
    x = dot(y, y) < dot(x, x) ? y : x;
    return dot(z, z) < dot(x, x) ? z : x;
}

// Whether way a is shorter than way b; between equally long ways the lower index of the triangle decides, then the
// lower index of the vertex.
bool is_shorter(Way a, Way b) {
    if (a.size != b.size) return a.size < b.size;
    return a.triangle < b.triangle || (a.triangle == b.triangle && a.vertex < b.vertex);
}

// The sector for the shortest way, whatever its direction: no direction has all three components below a half.
const uint SHORTEST = SECTORS / 2;
// Square of the cosine of the angle between the way in another sector and its triangle's normal, at least.
const float FACES2 = 0.9;

// Index of the sector of a direction of length 1, along the world's axes: a digit to the base 3 for each component.
uint sector_of(vec3 towards) {
    uvec3 digits = uvec3(1) + uvec3(greaterThan(towards, vec3(0.5))) - uvec3(lessThan(towards, vec3(-0.5)));
    return 9 * digits.x + 3 * digits.y + digits.z;
}

// Tests the way from the origin, where the tool's centre or a vertex is, to the triangle a b c. If the triangle faces
// the origin, keeps the way in `fronts` if it is the shortest so far; if the triangle faces away, keeps the least
// distance in `back`. `sign` is -1 where the origin is a vertex of the skin and the triangle is the tool's, else 1.
void consider(vec3 a, vec3 b, vec3 c, float sign, uint triangle, uint vertex, inout float back) {
    vec3 n = cross(b - a, c - a), x = nearest_of_triangle(a, b, c, n);
    Way way = Way(sign * x, length(x), triangle, vertex);
    if (dot(a, n) <= 0.0) {
        if (is_shorter(way, fronts[SHORTEST])) fronts[SHORTEST] = way;
        float square = dot(n, n), height = dot(a, n);
        if (SECTORS > 1 && square > 0.0 && way.size > 0.0 && height * height >= FACES2 * square * dot(x, x)) {
            // The skin of a hollow goes on beside the triangle, about in its plane.
            way.along = height / square * n;
            uint sector = sector_of(rotate(tool_turn, -inversesqrt(square) * n));
            if (is_shorter(way, fronts[sector])) {
                fronts[sector] = way;
                found |= 1u << sector;
            }
        }
    } else {
        back = min(back, way.size);
    }
}

uint vertex_at(uint i) { return fetch(chunk_vertices, i / 4)[i % 4]; }
uvec3 corners_at(uint i, out uint triangle) {
    triangle = fetch(chunk_triangles, i / 4)[i % 4];
    return fetch(triangles, triangle).xyz;
}

// Tests the way from a vertex of the tool to a triangle of the skin.
void consider_vertex(uint i, uint end, vec3 a, vec3 b, vec3 c, uint triangle, inout float back) {
    if (i >= end) return;
    uint vertex = vertex_at(i);
    vec3 x = fetch(skin_weights, vertex).xyz;
    consider(a - x, b - x, c - x, 1.0, triangle, vertex, back);
}

// Tests the way from a triangle of the tool to a vertex of the skin.
void consider_triangle(uint i, uint end, vec3 x, uint vertex, inout float back) {
    if (i >= end) return;
    uint triangle;
    uvec3 v = corners_at(i, triangle);
    vec3 a = fetch(skin_weights, v.x).xyz - x, b = fetch(skin_weights, v.y).xyz - x;
    vec3 c = fetch(skin_weights, v.z).xyz - x;
    consider(a, b, c, -1.0, triangle, vertex, back);
}

// Tests the ways between a chunk of the skin and a chunk `other` of the tool. A round of a loop tests four vertices or
// triangles of the tool, because Mesa's software renderer llvmpipe ends loops after 65,535 rounds.
void look_between(Chunk chunk, Chunk other, float limit, inout float back) {
    float radius = length(other.half_extent) + SLACK;
    uint end = other.vertex_first + other.vertex_count;
    for (uint k = gl_LocalInvocationID.x; k < chunk.triangle_count; k += SIZE) {
        uint triangle;
        uvec3 v = corners_at(chunk.triangle_first + k, triangle);
        vec3 a = skin[v.x].xyz, b = skin[v.y].xyz, c = skin[v.z].xyz;
        vec3 n = cross(b - a, c - a);
        vec3 nearest = nearest_of_triangle(a - other.centre, b - other.centre, c - other.centre, n);
        if (length(nearest) - radius > min(fronts[SHORTEST].size, limit)) continue;
        for (uint i = other.vertex_first; i < end; i += 4) {
            consider_vertex(i, end, a, b, c, triangle, back);
            consider_vertex(i + 1, end, a, b, c, triangle, back);
            consider_vertex(i + 2, end, a, b, c, triangle, back);
            consider_vertex(i + 3, end, a, b, c, triangle, back);
        }
    }
    end = other.triangle_first + other.triangle_count;
    for (uint l = gl_LocalInvocationID.x; l < chunk.vertex_count; l += SIZE) {
        uint vertex = vertex_at(chunk.vertex_first + l);
        vec3 x = skin[vertex].xyz;
        if (distance(x, other.centre) - radius > min(fronts[SHORTEST].size, limit)) continue;
        for (uint i = other.triangle_first; i < end; i += 4) {
            consider_triangle(i, end, x, vertex, back);
            consider_triangle(i + 1, end, x, vertex, back);
            consider_triangle(i + 2, end, x, vertex, back);
            consider_triangle(i + 3, end, x, vertex, back);
        }
    }
}

// Tests the ways to a chunk. Ways longer than `limit` (m) are not wanted; where a shorter way is found, `limit` becomes
// the length of the shortest one plus MARGIN.
void look_at(Chunk chunk, uint k, Place place, Place tool, inout float limit, inout float back) {
    for (uint l = gl_LocalInvocationID.x; l < chunk.embed_count; l += SIZE) {
        uint vertex = vertex_at(chunk.vertex_first + l);
        skin[vertex] = vec4(position(place, tool, vertex), 1.0);
    }
    settle();
    if (ROUND) {
        for (uint t = gl_LocalInvocationID.x; t < chunk.triangle_count; t += SIZE) {
            uint triangle;
            uvec3 v = corners_at(chunk.triangle_first + t, triangle);
            consider(skin[v.x].xyz, skin[v.y].xyz, skin[v.z].xyz, 1.0, triangle, 0, back);
        }
        limit = min(limit, workgroup_min(fronts[SHORTEST].size) + MARGIN);
        return;
    }
    for (uint other = 0; other < TOOL_CHUNKS; other++) {
        float apart = chunk_distance(chunk, middles[k], spreads[k], place, ball_centre(other, tool));
        if (apart - ball_radius(other) > limit) continue;
        look_between(chunk, chunks[TOOL_CHUNK_FIRST + other], limit, back);
        limit = min(limit, workgroup_min(fronts[SHORTEST].size) + MARGIN);
    }
}

// Shortest way found by all lanes; only lane 0 gets it.
Way shortest(Way own) {
    uint lane = gl_LocalInvocationID.x;
    barrier();
    ways[lane] = own;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width && is_shorter(ways[lane + width], ways[lane])) ways[lane] = ways[lane + width];
    }
    return ways[lane];
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    SkinPart part = parts[gl_WorkGroupID.x];
    Proxy proxy = proxies[part.proxy];
    Frame start = frames[proxy.frame];
    Place place = end_of(start), tool = tool_at_end();
    tool_turn = tool.rotation;
    for (uint s = 0; s < SECTORS; s++) fronts[s] = Way(vec3(0.0), REACH, NONE, NONE);
    float back = GAP_FAR;
    float limit = REACH;

    // If the whole part is too far away, none of its chunks is visited.
    float largest = sqrt(-workgroup_min(-largest_move2(proxy, start, place)));
    vec3 at = rotate_back(place.rotation, tool.centre - place.centre) - 0.5 * (part.low + part.high);
    float apart = box_distance(at, 0.5 * (part.high - part.low)) - 1.001 * proxy.weight_bound * largest - SLACK;
    uint count = apart - (ROUND ? 0.0 : RADIUS) > REACH ? 0 : part.chunk_count;
    if (count == 0) {
        for (uint s = lane; s < SECTORS; s += SIZE) {
            gaps[gl_WorkGroupID.x * SECTORS + s] = SkinGap(vec3(0.0), NONE, GAP_FAR);
        }
        return;
    }

    for (uint k = lane; k < count; k += SIZE) {
        Chunk chunk = chunks[part.chunk_first + k];
        vec3 middle, spread;
        spread_of(chunk, start, place, middle, spread);
        bounds[k] = chunk_bound(chunk, middle, spread, place, tool);
        middles[k] = middle;
        spreads[k] = spread;
    }
    for (uint turn = 0; turn < count; turn++) {
        // The barrier makes what the last round wrote visible to all lanes, so that all choose one and the same chunk.
        barrier();
        float least = GAP_FAR;
        uint next = 0;
        for (uint k = 0; k < count; k++) {
            if (bounds[k] < least) {
                least = bounds[k];
                next = k;
            }
        }
        barrier();
        if (!(least <= limit)) break;
        if (lane == 0) bounds[next] = GAP_FAR;
        look_at(chunks[part.chunk_first + next], next, place, tool, limit, back);
    }
    back = workgroup_min(back);
    if (lane == 0) known = 1u << SHORTEST;
    barrier();
    atomicOr(known, found);
    barrier();
    for (uint s = 0; s < SECTORS; s++) {
        Way front = Way(vec3(0.0), REACH, NONE, NONE);
        if ((known >> s & 1u) != 0) front = shortest(fronts[s]);
        if (lane == 0) {
            vec3 along = rotate(tool.rotation, front.along);
            gaps[gl_WorkGroupID.x * SECTORS + s] = SkinGap(along, front.triangle, back);
        }
    }
}
