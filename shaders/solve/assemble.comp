#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/rounding.glsl"
#include "shared/contact_law.glsl"

// Solve: right-hand side b and preconditioner of the linear system A x = b, whose unknowns x are changes of velocity,
// at the nodes. One workgroup runs for each block of nodes: neighbouring free nodes, or nodes attached to one dynamic
// core (rigid body inside a soft one, whose motion the solver finds). Nodes whose motion is prescribed are in no block.
// The f64 reference is oracle::step.
//
// Symbols: step h; mass m, gravity g, damping alpha and beta, velocity v of a node; force f and stiffness K of an
// element; and of a contact (shared/contact_law.glsl) the weight w of the node, area a, stiffness k, damping d, depth
// delta, rate delta', normal n, friction c and tangential velocity v_t. A frame is a rigid coordinate frame.
//
// The kernel writes:
// - the right-hand side b of each node: h m g - h alpha m v, plus h times the loads on it, plus the sum over its
//   elements of what elastic/element_forces and elastic/mean_dilatation write, minus the sum over its contacts of
//   w ((h a k delta + (h^2 k + h d) a delta') n + h c v_t), plus the carried residual b - A x of the last solve. Were
//   this residual not carried over, its impulse would be lost in every step, always in the same smooth motions:
//   iterations after a warm start reduce the residual of smooth motions last.
// - for each free node, the inverse of its 3x3 diagonal block D of A, and, where there are a coarse space and contacts,
//   the block E, which is D without the contacts' part; for each attached node, its diagonal block itself, from which
//   solve/cores computes the diagonal block of the core.
// - where nodes are supported (shared/support.glsl), b and D as the supports restrict them, and what these take from b.
// - for each block of nodes, b . D^-1 b, with D the nodes' diagonal blocks, and (e . D^-1 e) eps^2, where e sums the
//   magnitudes of the terms of b, and eps is ROUNDING: an estimate of b . D^-1 b for a body at rest, whose b is
//   nothing but rounding error. A body with a coarse space adds that space's part (shared/share.glsl).
// - for each block of nodes, its rotation (the polar part of its nodes' affine fit), and P^T b, the restriction of b to
//   its modes (basis of the coarse space, shared/coarse_vector.glsl), which are in the axes that this rotation gives.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const bool PATCHES = false;
layout(constant_id = 5) const uint TETRAHEDRA = 0;
layout(constant_id = 7) const bool FRICTION = false;
layout(constant_id = 8) const bool JOINTS = false;
layout(constant_id = 9) const bool SUPPORTS = false;         // whether some nodes are supported (shared/support.glsl)
layout(constant_id = 10) const bool LOADS = false;
layout(constant_id = 11) const uint NODES = 0;              // number of nodes, behind which external_forces has the cores
layout(constant_id = 13) const uint HELD = 0;               // number of cores that haptic devices hold

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
READ_ONLY(uvec4, blocks);
READ_ONLY(uvec4, block_nodes);
READ_ONLY(vec4, block_places);     // xyz: middle of a block in its frame, m; w: 1 / the block's size, 1/m
READ_ONLY(vec4, block_moments);    // inverse of sum x x^T over a block, see rotation_of: xx yy zz, xy xz yz
READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(vec4, node_rest);        // xyz: rest position, m; w: mass, kg
READ_ONLY(vec4, velocity);
READ_ONLY(vec4, displacement);
READ_ONLY(uvec4, node_elements);
READ_ONLY(vec4, element_forces);
READ_ONLY(vec4, gradients);
READ_ONLY(vec4, patch_rows);
READ_ONLY(uvec4, node_entries);
READ_ONLY(uvec4, sorted);
READ_ONLY(uvec4, contacts);
READ_ONLY(vec4, carried_residual);        // carried residual b - A x of the last step
layout(scalar) readonly buffer Rigids { Rigid rigids[]; };
layout(scalar) writeonly buffer Rhs { vec4 rhs[]; };
layout(scalar) writeonly buffer Inverse { vec4 inverse[]; };      // D^-1; attached nodes: D; xx yy zz, xy xz yz
layout(scalar) writeonly buffer BlocksWithoutContacts { vec4 blocks_without_contacts[]; };     // E; xx yy zz, xy xz yz
layout(scalar) writeonly buffer Partials { vec2 partials[]; };    // b . D^-1 b and (e . D^-1 e) eps^2 of each block
layout(scalar) writeonly buffer RestrictedRhs { vec4 restricted_rhs[]; };      // P^T b, three texels per block
layout(scalar) buffer BlockRotations { vec4 block_rotations[]; };  // rotation of each block in its frame
layout(scalar) writeonly buffer BlockTurns { vec4 block_turns[]; };        // rotation of each block in the world
READ_ONLY(vec4, coarse_scales);
layout(scalar) readonly buffer Joints { Joint joints[]; };
layout(scalar) readonly buffer JointSides { uint joint_sides[]; };
READ_ONLY(vec4, external_forces);      // loads on nodes, then force and torque on each dynamic core (elastic/loads)
layout(scalar) buffer SupportedNodes { Supported supported[]; };

const bool SMOOTHS = CONTACT || SUPPORTS;     // whether P differs from P_0 (shared/preconditioner.glsl)
// Share of the trace of D^-1 that takes the place of its entries along directions that supports take from a node; more
// than zero, since solve/gather divides by entries of D^-1.
const float LITTLE = 1.0e-6;
const uint SUMS = 7;

#include "shared/contact.glsl"
#include "shared/entries.glsl"
#include "shared/rotation.glsl"
#include "shared/polar.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"
#include "shared/sums.glsl"
#include "shared/blocks.glsl"
#include "shared/coarse_vector.glsl"
#include "shared/core.glsl"
#include "shared/held.glsl"
#include "shared/followed.glsl"
#include "shared/share.glsl"
#include "shared/joint.glsl"
#include "shared/support.glsl"

// Adds the terms of contacts to a node's right-hand side `b`, to the magnitudes `e` of its terms, and to its diagonal
// block, whose diagonal is `a` and whose off-diagonal (xy xz yz) is `c`.
void add_contacts(uint i, inout vec3 b, inout vec3 e, inout vec3 a, inout vec3 c) {
    float h = params.dt;
    uvec2 run = entries_of(i);
    for (uint k = run.x; k < run.x + run.y;) {
        uint touching = entry_at(k).x;
        Contact contact = contact_at(touching);
        // The tetrahedra in which a triangle's corners are embedded share nodes. So a contact may have several entries
        // at a node, which are adjacent: their weights are summed, and the diagonal block gets the square of the sum.
        float w = 0.0;
        for (; k < run.x + run.y; k++) {
            uvec2 entry = entry_at(k);
            if (entry.x != touching) break;
            w += uintBitsToFloat(entry.y);
        }
        float g = normal_operator(contact, h), f = w * normal_impulse(contact, h);
        vec3 n = contact.normal;
        b -= f * n;
        e += abs(f * n);
        a += g * w * w * n * n;
        c += g * w * w * n.xxy * n.yzz;
        if (FRICTION) {
            // Friction acts along the tangents: its matrix is I - n n^T.
            float viscous = friction_operator(contact, h);
            b -= w * viscous * contact.slip;
            e += abs(w * viscous * contact.slip);
            a += viscous * w * w * (1.0 - n * n);
            c -= viscous * w * w * n.xxy * n.yzz;
        }
    }
}

// Rotation of a block in its frame: the polar part of I + sum d x^T (sum x x^T)^-1 / size, with displacements d of its
// nodes and their rest positions x from the block's middle, divided by the block's size. `sums` is sum d x^T; the
// iteration that finds the polar part starts from the block's previous rotation.
vec4 rotation_of(uint b, float inverse_size, mat3 sums) {
    vec3 d = fetch(block_moments, 2 * b).xyz, o = fetch(block_moments, 2 * b + 1).xyz;
    mat3 moments = mat3(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z);
    bool lost;
    return polar(mat3(1.0) + inverse_size * sums * moments, block_rotations[b], lost);
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    Block block = block_of(gl_WorkGroupID.x);
    vec4 place = fetch(block_places, gl_WorkGroupID.x), turn = frames[block.frame].rotation;
    float h = params.dt;
    CoarseVector coarse_vector = coarse_zero(), moved = coarse_zero();
    vec3 sums = vec3(0.0);
    for (uint at = lane; at < block.count; at += SIZE) {
        uvec4 node = block_node(block, at);
        int i = int(node.x);
        vec4 rest = fetch(node_rest, i);
        vec3 v = fetch(velocity, i).xyz;
        float damping = node_damping(node);
        vec3 b = h * (rest.w * params.gravity - damping * v) + fetch(carried_residual, i).xyz;
        vec3 e = abs(h * rest.w * params.gravity) + abs(h * damping * v);
        if (LOADS) {
            vec3 load = h * fetch(external_forces, i).xyz;
            b += load;
            e += abs(load);
        }
        // The node's diagonal block: xx yy zz in `a`, xy xz yz in `c`.
        vec3 a = vec3(rest.w + h * damping), c = vec3(0.0);
        for (uint k = 0; k < node.z; k++) {
            uvec4 entries = fetch(node_elements, node.y + k);
            for (uint l = 0; l < 4; l++) {
                uint entry = entries[l];
                vec3 f = fetch(element_forces, entry).xyz;
                b += f;
                e += abs(f);
                if (PATCHES && entry >= 4 * (TETRAHEDRA + 1)) {
                    vec3 row = fetch(patch_rows, entry - 4 * (TETRAHEDRA + 1)).xyz;
                    a += row * row;
                    c += row.xxy * row.yzz;
                    continue;
                }
                uint first = GRADIENT_TEXELS * (entry / 4);
                vec4 g1 = fetch(gradients, first), g2 = fetch(gradients, first + 1);
                vec3 g3 = fetch(gradients, first + 2).xyz;
                uint corner = entry % 4;
                vec3 g = corner == 0 ? -g1.xyz - g2.xyz - g3 : (corner == 1 ? g1.xyz : (corner == 2 ? g2.xyz : g3));
                a += g1.w * dot(g, g) + (g1.w + g2.w) * g * g;
                c += (g1.w + g2.w) * g.xxy * g.yzz;
                add_geometric_block(g, fetch(gradients, first + 3).xyz, fetch(gradients, first + 4).xyz, a, c);
            }
        }
        vec3 without_contacts = a, without_contacts_off = c;
        vec4 support = vec4(0.0);
        if (CONTACT) add_contacts(node.x, b, e, a, c);
        if (SUPPORTS) {
            support = supported[i].left;
            vec3 along = along_support(support, b);
            supported[i].taken = b - along;
            b = along;
            e = magnitudes_along_support(support, e);
            restrict_block(support, 0.0, without_contacts, without_contacts_off);
            restrict_block(support, (a.x + a.y + a.z) / 3.0, a, c);
        }
        rhs[i] = vec4(b, 0.0);
        if (block.rigid != NONE) {
            vec3 arm = rotate(turn, rest.xyz);
            coarse_vector.c0 += b;
            coarse_vector.c1 += cross(arm, b);
            inverse[2 * i] = vec4(a, 0.0);
            inverse[2 * i + 1] = vec4(c, 0.0);
            continue;
        }
        vec3 diagonal, off;
        symmetric_inverse(a, c, diagonal, off);
        // Rounding leaves a little of the residual where the node cannot move. It must not become motion: it does not
        // shrink with the rest of the residual.
        if (SUPPORTS) restrict_block(support, LITTLE * (diagonal.x + diagonal.y + diagonal.z), diagonal, off);
        vec3 z = symmetric_times(diagonal, off, b);
        sums.xy += vec2(dot(b, z), ROUNDING * dot(e, ROUNDING * e * diagonal));
        if (COARSE) {
            vec3 where = (rest.xyz - place.xyz) * place.w;
            vec3 on_modes = b, lost = e;
            if (SMOOTHS) {
                blocks_without_contacts[2 * i] = vec4(without_contacts, 0.0);
                blocks_without_contacts[2 * i + 1] = vec4(without_contacts_off, 0.0);
                on_modes = symmetric_times(without_contacts, without_contacts_off, z);
                lost = symmetric_times(without_contacts, without_contacts_off, symmetric_times(diagonal, off, e));
            }
            sums.z += ROUNDING * dot(lost, ROUNDING * lost);
            add_restriction(coarse_vector, on_modes, where);
            add_restriction(moved, fetch(displacement, i).xyz, where);
        }
        inverse[2 * i] = vec4(diagonal, 0.0);
        inverse[2 * i + 1] = vec4(off, 0.0);
    }
    if (block.rigid != NONE) {
        Rigid rigid = rigids[block.rigid];
        if (lane == 0 && gl_WorkGroupID.x == rigid.block_first) {
            coarse_vector.c1 += frames[block.frame].gyroscopic;
            if (LOADS) {
                coarse_vector.c0 += h * fetch(external_forces, NODES + 2 * block.rigid).xyz;
                coarse_vector.c1 += h * fetch(external_forces, NODES + 2 * block.rigid + 1).xyz;
            }
            uint held = held_index(block.rigid);
            if (held != NONE) {
                float rows[6] = params.held[held].rhs;
                coarse_vector.c0 += vec3(rows[0], rows[1], rows[2]);
                coarse_vector.c1 += vec3(rows[3], rows[4], rows[5]);
            }
        }
        if (JOINTS && lane == 0 && gl_WorkGroupID.x == rigid.block_first) {
            for (uint k = rigid.joint_first; k < rigid.joint_first + rigid.joint_count; k++) {
                add_springs(joint_sides[k] / 2, joint_sides[k] % 2, coarse_vector.c0, coarse_vector.c1);
            }
        }
        follow(rigid.hinge, coarse_vector.c0, coarse_vector.c1);
        if (lane == 0 && gl_WorkGroupID.x == rigid.block_first) {
            coarse_vector.c0 += vec3(rigid.carried_residual[0], rigid.carried_residual[1], rigid.carried_residual[2]);
            coarse_vector.c1 += vec3(rigid.carried_residual[3], rigid.carried_residual[4], rigid.carried_residual[5]);
        }
    }
    vec4 p[3] = packed(coarse_vector);
    vec4 totals[SUMS] = vec4[SUMS](vec4(sums, 0.0), p[0], p[1], p[2], vec4(moved.c1, 0.0), vec4(moved.c2, 0.0), vec4(moved.c3, 0.0));
    workgroup_sums(totals, COARSE ? 7 : (block.rigid != NONE ? 4 : 1));
    if (lane != 0) return;
    vec2 products = totals[0].xy;
    if (COARSE && block.rigid == NONE) products.y += coarse_share(coarse_index_of(gl_WorkGroupID.x)) * totals[0].z;
    partials[gl_WorkGroupID.x] = products;
    if (COARSE && block.rigid == NONE) {
        vec4 q = rotation_of(gl_WorkGroupID.x, place.w, mat3(totals[4].xyz, totals[5].xyz, totals[6].xyz));
        block_rotations[gl_WorkGroupID.x] = q;
        turn = compose(turn, q);
    }
    block_turns[gl_WorkGroupID.x] = turn;
    p = packed(to_frame(unpacked(totals[1], totals[2], totals[3]), turn));
    for (int k = 0; k < 3; k++) restricted_rhs[3 * coarse_index_of(gl_WorkGroupID.x) + k] = p[k];
}
