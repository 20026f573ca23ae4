#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/args.glsl"
#include "shared/contact_law.glsl"

// Contact stage of a step: writes for each contact (a skin vertex inside the other body, or the overlap of a triangle
// with it) the record that the solver reads. A contact's relative velocity along its normal n is J v = n.(v(s1) -
// v(s2)), with s1 and s2 its points on bodies a and b. The Jacobian J is kept as at most sixteen weighted nodes and,
// where the tool (rigid body that the haptic device leads) takes part, the tool's twist. A vertex of a soft body moves
// with the four nodes of its tetrahedron; the point opposite to the vertex lies in a triangle of the other body, whose
// corners move with four to twelve nodes. The kernel also writes J v at the start of the step and the friction
// coefficient, which holds for a predicted sliding speed (shared/contact_law.glsl).
//
// Each entry (node, weight) of a contact goes onto one of the lists of that node, from which contact/sort makes the
// transposed index from nodes to contacts. One invocation runs for each contact. The f64 reference implementation is
// oracle::contact (gather, gather_triangles); the test also follows the lists. A frame is the rigid coordinate frame of
// a body.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool FRICTION = false;
layout(constant_id = 4) const bool TOOL = true;  // true: a rigid tool exists; false: the device may hold a soft body
layout(constant_id = 6) const uint RIGIDS = 0;  // rigid bodies among the unknowns; the tool is the last
layout(constant_id = 3) const uint LISTS = 8;    // lists of a node, as many as a workgroup of contact/sort has lanes

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) readonly buffer Pairs { Pair pairs[]; };
READ_ONLY(vec4, candidate_normals);
layout(scalar) readonly buffer ContactSource { uint contact_source[]; };      // candidate of each contact
READ_ONLY(vec4, candidate_hits);        // depth (m), barycentric weights of second and third corner, area (m^2)
READ_ONLY(uvec4, candidate_what);       // vertex, 2 * pair + (1: vertex of body b), triangle of the other body
READ_ONLY(uvec4, triangles);
READ_ONLY(uvec4, skin_nodes);  // four nodes of each skin vertex; NONE first: vertex of a rigid body
READ_ONLY(vec4, skin_weights);
READ_ONLY(vec4, skin);
READ_ONLY(vec4, velocity);
READ_ONLY(vec4, solution);      // change of each node's velocity over the last step, m/s
layout(scalar) readonly buffer SolveIn { Solve solve; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
READ_ONLY(uvec4, frames);
layout(scalar) writeonly buffer Contacts { Contact contacts[]; };
layout(scalar) writeonly buffer EntryNodes { uvec4 entry_nodes[]; };  // four quads (groups of four nodes) per contact
layout(scalar) writeonly buffer EntryWeights { vec4 entry_weights[]; };
layout(scalar) buffer NodeListCounts { uint node_list_counts[]; };  // number of each node's lists that are in use
layout(scalar) buffer NodeLists { uint node_lists[]; };  // LISTS heads per node: last entry put on each list, or NONE
layout(scalar) writeonly buffer NextEntries { uint next_entries[]; };     // the entry after each in its list
layout(scalar) writeonly buffer TouchedNodes { uint touched_nodes[]; };   // every node with entries
layout(scalar) buffer Args { uint args[]; };

#include "shared/frame.glsl"

uint quads = 0;
uvec4 nodes[4];
vec4 weights[4];

// Adds a skin vertex's four nodes with their weights times `share`; a vertex of a rigid body has none. Corners of a
// triangle that lie in one tetrahedron, as most do, share a quad (group of four nodes).
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

// Puts an entry of contact c onto a list of `node`; each list gets the entries of every LISTS-th contact.
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
    vec4 direction = fetch(candidate_normals, source);
    vec3 n = direction.xyz;
    float stiffness = direction.w * pair.stiffness;
    float damping = (pair.damps_tips != 0 ? direction.w : 1.0) * pair.damping;
    float sign = (side & 1) != 0 ? -1.0 : 1.0;
    add(vertex, sign);
    if (triangle != NONE) {
        uvec3 corners = fetch(triangles, triangle).xyz;
        add(corners.x, -sign * (1.0 - found.y - found.z));
        add(corners.y, -sign * found.y);
        add(corners.z, -sign * found.z);
    }
    float rate = 0.0;
    vec3 relative = vec3(0.0);      // v(s1) - v(s2), m/s; if FRICTION is false, velocities of nodes are left out
    vec3 change = vec3(0.0);        // change of `relative` by free nodes and the tool over the last step, m/s, if FRICTION
    for (uint q = 0; q < quads; q++) {
        entry_nodes[4 * c + q] = nodes[q];
        entry_weights[4 * c + q] = weights[q];
        for (uint k = 0; k < 4; k++) {
            vec3 v = fetch(velocity, nodes[q][k]).xyz;
            rate += weights[q][k] * dot(n, v);
            if (FRICTION) {
                relative += weights[q][k] * v;
                change += weights[q][k] * fetch(solution, nodes[q][k]).xyz;
            }
            if (weights[q][k] != 0.0) list(16 * c + 4 * q + k, nodes[q][k], c);
        }
    }
    // `at` is the point where the contact acts on a rigid body. For the normal force s1 and s2 do equally well, since
    // both lie on one line along n. Friction acts on a rigid body at the contact's point on the other body, so that
    // both friction forces of a contact act at one point; on a soft body that the device holds, it acts at this body's
    // point.
    vec3 at = fetch(skin, vertex).xyz;
    if (pair.by_triangles != 0) {
        // The contact's point is the centre of pressure on the triangle; the other body is rigid.
        uvec3 corners = fetch(triangles, triangle).xyz;
        at = (1.0 - found.y - found.z) * fetch(skin, corners.x).xyz + found.y * fetch(skin, corners.y).xyz
            + found.z * fetch(skin, corners.z).xyz;
    } else if (FRICTION) {
        float rigid = TOOL ? pair.tool_sign : -pair.tool_sign;
        bool first = rigid > 0.0 || (rigid == 0.0 && pair.kinematic_frame[0] != NONE);
        bool second = rigid < 0.0 || pair.kinematic_frame[1] != NONE;
        if ((side & 1) == 0 ? first : second && !first) at -= sign * found.x * n;
    }
    vec3 arm = at - params.tool_centre;
    vec3 lever = pair.tool_sign * cross(arm, n);
    vec3 linear = vec3(params.tool_twist[0], params.tool_twist[1], params.tool_twist[2]);
    vec3 angular = vec3(params.tool_twist[3], params.tool_twist[4], params.tool_twist[5]);
    if (TOOL && pair.tool_sign != 0.0) {
        rate += pair.tool_sign * dot(n, linear) + dot(lever, angular);
        relative += pair.tool_sign * (linear + cross(angular, arm));
        if (FRICTION) {
            float x[6] = iterates[solve.current * RIGIDS + RIGIDS - 1].x;
            change += pair.tool_sign * (vec3(x[0], x[1], x[2]) + cross(vec3(x[3], x[4], x[5]), arm));
        }
    }
    for (uint k = 0; k < 2; k++) {
        // A kinematic rigid body (one whose motion is prescribed) contributes the velocity of its frame.
        if (pair.kinematic_frame[k] == NONE) continue;
        Frame frame = frame_at(pair.kinematic_frame[k]);
        vec3 v = (k == 0 ? 1.0 : -1.0) * (frame.linear + cross(frame.angular, at - frame.centre));
        rate += dot(n, v);
        relative += v;
    }
    vec3 slip = vec3(0.0);
    float friction = 0.0;
    if (FRICTION) {
        slip = relative - dot(n, relative) * n;
        float force = found.w * start_pressure(found.x, rate, stiffness, damping);
        // The last step may have had another length, and its solution may have been rejected.
        bool is_known = solve.solution_dt > 0.0;
        change = is_known ? (params.dt / solve.solution_dt) * change : vec3(0.0);
        float predicted = predicted_slip(slip, change - dot(n, change) * n);
        friction = friction_coefficient(force, predicted, params.friction, params.friction_speed);
    }
    contacts[c] = Contact(n, found.w, arm, pair.tool_sign, found.x, rate, stiffness, damping, friction, slip, quads,
        vertex, side, triangle, found.yz, vec2(0.0));
}
