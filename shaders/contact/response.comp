#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/contact_law.glsl"

// Contact: what the solver needs to know of each colliding vertex. J v = n.(v(s1) - v(s2)) as at most sixteen weighted
// nodes (s1 or s2 is a skin vertex with four; the opposing point lies in a triangle: four to three times four) and the tool's
// twist; the rate J v at the start; and the coefficient of friction of the start (shared/contact_law.glsl).
// Each entry goes onto one of its node's lists, from which sort.comp makes the transposed index. One invocation a contact.
// Oracle: oracle::contact::gather; the lists walked by its test.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool FRICTION = false;
layout(constant_id = 4) const bool TOOL = true;              // else tool_sign marks a held body, which its nodes move
layout(constant_id = 3) const uint LISTS = 8;                // a node; as many as a workgroup of sort.comp has lanes

layout(scalar) readonly buffer Params { StepParams params; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
READ_ONLY(vec4, candidate_normals);
layout(scalar) readonly buffer ContactSource { uint contact_source[]; };
READ_ONLY(vec4, candidate_hits);
READ_ONLY(uvec4, candidate_what);
READ_ONLY(uvec4, triangles);
READ_ONLY(uvec4, skin_nodes);
READ_ONLY(vec4, skin_weights);
READ_ONLY(vec4, skin);
READ_ONLY(vec4, velocity);
layout(scalar) readonly buffer Frames { Frame frames[]; };
layout(scalar) writeonly buffer Contacts { Contact contacts[]; };
layout(scalar) writeonly buffer EntryNodes { uvec4 entry_nodes[]; };      // four quads a contact
layout(scalar) writeonly buffer EntryWeights { vec4 entry_weights[]; };
layout(scalar) buffer NodeListCounts { uint node_list_counts[]; };        // zero; lists of each node in use
layout(scalar) buffer NodeLists { uint node_lists[]; };                   // LISTS a node: NONE, or the last entry put there
layout(scalar) writeonly buffer NextEntries { uint next_entries[]; };     // before it in its list
layout(scalar) writeonly buffer TouchedNodes { uint touched_nodes[]; };   // each node with entries
layout(scalar) buffer Args { uint args[]; };

uint quads = 0;
uvec4 nodes[4];
vec4 weights[4];

// A skin vertex's four nodes, weights times `share`; none where it rides on a rigid body. The corners of a triangle most
// often lie in one tetrahedron and then share a quad.
void add(uint vertex, float share) {
    uvec4 own = fetch(skin_nodes, vertex);
    if (own.x == NONE) return;
    vec4 w = share * fetch(skin_weights, vertex);
    for (uint q = 0; q < quads; q++) {
        if (nodes[q] == own) {
            weights[q] += w;
            return;
        }
    }
    nodes[quads] = own;
    weights[quads] = w;
    quads += 1;
}

// A list holds the entries of every LISTS-th contact.
void list(uint entry, uint node, uint c) {
    uint before = atomicExchange(node_lists[node * LISTS + c % LISTS], entry);
    next_entries[entry] = before;
    if (before == NONE && atomicAdd(node_list_counts[node], 1) == 0) touched_nodes[atomicAdd(args[3 * ARGS_NODES], 1)] = node;
}

void main() {
    uint c = gl_GlobalInvocationID.x;
    if (c >= counts.contacts) return;
    uint source = contact_source[c];
    vec4 found = fetch(candidate_hits, source);
    uvec4 what = fetch(candidate_what, source);
    uint vertex = what.x, side = what.y, triangle = what.z;
    Pair pair = pairs[side / 2];
    vec3 n = fetch(candidate_normals, source).xyz;
    float sign = (side & 1) != 0 ? -1.0 : 1.0;
    add(vertex, sign);
    if (triangle != NONE) {
        uvec3 corners = fetch(triangles, triangle).xyz;
        add(corners.x, -sign * (1.0 - found.y - found.z));
        add(corners.y, -sign * found.y);
        add(corners.z, -sign * found.z);
    }
    float rate = 0.0;
    vec3 relative = vec3(0.0);      // v1 - v2, where there is friction
    for (uint q = 0; q < quads; q++) {
        entry_nodes[4 * c + q] = nodes[q];
        entry_weights[4 * c + q] = weights[q];
        for (uint k = 0; k < 4; k++) {
            vec3 v = fetch(velocity, nodes[q][k]).xyz;
            rate += weights[q][k] * dot(n, v);
            if (FRICTION) relative += weights[q][k] * v;
            if (weights[q][k] != 0.0) list(16 * c + 4 * q + k, nodes[q][k], c);
        }
    }
    // s1 and s2 are on one line along n: where a rigid skin feels the pressure, either will do. Friction is felt at the point
    // of the body it meets, so that the two forces of a pair act at one point. A held body feels it at its own.
    vec3 at = fetch(skin, vertex).xyz;
    if (FRICTION) {
        float rigid = TOOL ? pair.tool_sign : -pair.tool_sign;
        bool first = rigid > 0.0 || (rigid == 0.0 && pair.driven_frame[0] != NONE);
        bool second = rigid < 0.0 || pair.driven_frame[1] != NONE;
        if ((side & 1) == 0 ? first : second && !first) at -= sign * found.x * n;
    }
    vec3 arm = at - params.tool_centre;
    vec3 lever = pair.tool_sign * cross(arm, n);
    vec3 linear = vec3(params.tool_twist[0], params.tool_twist[1], params.tool_twist[2]);
    vec3 angular = vec3(params.tool_twist[3], params.tool_twist[4], params.tool_twist[5]);
    if (TOOL && pair.tool_sign != 0.0) {
        rate += pair.tool_sign * dot(n, linear) + dot(lever, angular);
        relative += pair.tool_sign * (linear + cross(angular, arm));
    }
    for (uint k = 0; k < 2; k++) {
        // A rigid skin on a driven frame.
        if (pair.driven_frame[k] == NONE) continue;
        Frame frame = frames[pair.driven_frame[k]];
        vec3 v = (k == 0 ? 1.0 : -1.0) * (frame.linear + cross(frame.angular, at - frame.centre));
        rate += dot(n, v);
        relative += v;
    }
    vec3 slip = vec3(0.0);
    float friction = 0.0;
    if (FRICTION) {
        slip = relative - dot(n, relative) * n;
        float force = found.w * start_pressure(found.x, rate, pair.stiffness, pair.damping);
        friction = friction_coefficient(force, slip, params.friction, params.friction_speed);
    }
    contacts[c] = Contact(n, found.w, arm, pair.tool_sign, found.x, rate, pair.stiffness, pair.damping, friction, slip, quads,
        vertex, side, triangle, found.yz);
}
