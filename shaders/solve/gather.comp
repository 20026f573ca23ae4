#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/rounding.glsl"
#include "shared/rotation.glsl"

// Solve: operator product w = A p at the nodes, for the linear system A x = b with preconditioner M. The kernel sums w
// from the output of solve/contact_product or solve/contact_iteration and the rows of the assembled operator
// (shared/rows.glsl) or, where the operator is matrix-free, the output of solve/element_product and solve/patch_product;
// computes inner products with w; and restricts w and the residual r to the modes of each block, P^T w and P^T r. A block is a set of nodes that one
// workgroup works on; its modes are the basis of the preconditioner's coarse space (shared/coarse_vector.glsl). For
// nodes attached to a rigid core (rigid body inside a soft one) the core's six rows take the place of modes. D is made
// of the nodes' 3x3 diagonal blocks of A. MODE selects p, the two inner products and what some buffers hold:
//   GATHER_WARM_START, before the loop: p the last solution or the trend d, which is the difference of the last two
//     solutions; p . b, p . w and d . w, without the rows of cores and tool; `residual_or_rhs` is b.
//   GATHER_LOOP, in an iteration: p = u = M^-1 r; r . u, w . u, including the rows of cores and tool; `residual_or_rhs`
//     is r.
//   GATHER_END, after the loop: p the solution x; r . D^-1 r with r = b - w; and e . M^-1 e, where e = HALF_ULP D x
//     estimates the rounding error of w that follows from rounding of x; `residual_or_rhs` is b.
// One workgroup runs for each block of free nodes, for each block of attached nodes, or for the tool's six rows: these
// are variants, selected by ROLE, that run concurrently. The tool is the rigid body that the haptic device leads. The
// f64 reference is oracle::step. A frame is a rigid coordinate frame.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint BLOCKS = 0;          // number of blocks of nodes; the tool's rows come after them
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const bool COARSE = false;
layout(constant_id = 4) const uint MODE = 1;            // GATHER_* of shared/roles.glsl
layout(constant_id = 6) const uint RIGIDS = 0;          // rigid bodies: dynamic cores and the tool
layout(constant_id = 7) const bool FRICTION = false;
layout(constant_id = 8) const uint ROLE = 0;            // FREE_NODES, ATTACHED_NODES or TOOL_ROWS of shared/roles.glsl
layout(constant_id = 9) const uint FIRST = 0;           // first of the blocks that this ROLE works on
layout(constant_id = 10) const bool JOINTS = false;
layout(constant_id = 5) const bool SUPPORTS = false;         // whether some nodes are supported (shared/support.glsl)
layout(constant_id = 11) const bool ASSEMBLED = false;      // whether the operator is kept as a matrix
layout(constant_id = 13) const uint HELD = 0;               // number of cores that haptic devices hold

layout(push_constant) uniform Which { uint set; };      // which of two sets of iterates holds u and r in GATHER_LOOP

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(vec4, block_turns);                           // rotation of each block, world
READ_ONLY(uvec4, blocks);
READ_ONLY(uvec4, block_nodes);
READ_ONLY(vec4, block_places);  // xyz: middle of a block in its frame, m; w: 1 / the block's size, 1/m
READ_ONLY(uvec4, coarse_blocks);
READ_ONLY(vec4, node_rest);
READ_ONLY(uvec4, node_elements);
READ_ONLY(vec4, element_forces);
READ_ONLY(vec4, stiffness_blocks);
READ_ONLY(uvec4, node_entries);
READ_ONLY(uvec4, sorted);
layout(scalar) readonly buffer CountsIn { Counts counts; };
READ_ONLY(uvec4, contacts);
READ_ONLY(vec4, contact_forces);
READ_ONLY(vec4, change);          // p
READ_ONLY(vec4, trend);
READ_ONLY(vec4, residual_or_rhs);
READ_ONLY(vec4, inverse);         // D^-1, two texels per node
READ_ONLY(vec4, blocks_without_contacts);     // E of shared/preconditioner.glsl, two texels per node
layout(scalar) readonly buffer Rigids { Rigid rigids[]; };
layout(scalar) readonly buffer Iterates { RigidIterate iterates[]; };
layout(scalar) writeonly buffer OperatorProduct { vec4 operator_product[]; };      // w
layout(scalar) writeonly buffer Dots { vec2 dots[]; };
layout(scalar) writeonly buffer Projections { vec4 projections[]; };     // inner products of GATHER_WARM_START
layout(scalar) writeonly buffer RestrictedProduct { vec4 restricted_product[]; };  // P^T w, three texels per block
layout(scalar) writeonly buffer RestrictedResidual { vec4 restricted_residual[]; };   // P^T r
layout(scalar) readonly buffer SolveIn { Solve solve; };
READ_ONLY(vec4, coarse_scales);
layout(scalar) readonly buffer Joints { Joint joints[]; };
layout(scalar) readonly buffer JointSides { uint joint_sides[]; };     // joints of each core: 2 * joint + side (0 or 1)
layout(scalar) buffer SupportedNodes { Supported supported[]; };       // GATHER_END writes the impulses that hold the nodes

const bool SMOOTHS = CONTACT || SUPPORTS;     // whether P differs from P_0 (shared/preconditioner.glsl)

const uint SUMS = 7;
#include "shared/roles.glsl"
#include "shared/sums.glsl"
#include "shared/blocks.glsl"
#include "shared/coarse_vector.glsl"
#include "shared/symmetric.glsl"
#include "shared/preconditioner.glsl"
#include "shared/core.glsl"
#include "shared/held.glsl"
#include "shared/followed.glsl"
#include "shared/share.glsl"
#include "shared/rows.glsl"
#include "shared/entries.glsl"
#include "shared/gather.glsl"
#include "shared/contact.glsl"
#include "shared/six.glsl"
#include "shared/joint.glsl"
#include "shared/support.glsl"

// Adds the forces and torques on the tool of those contacts that this lane works on.
void add_tool_contacts(uint contact_count, inout vec3 force_sum, inout vec3 torque_sum) {
    for (uint c = gl_LocalInvocationID.x; c < contact_count; c += SIZE) {
        Contact contact = contact_at(c);
        float sign = contact.tool_sign;
        if (sign == 0.0) continue;
        vec4 force = fetch(contact_forces, c);
        vec3 along = sign * (FRICTION ? force.xyz : force.w * contact.normal);
        force_sum += along;
        torque_sum += cross(contact.arm, along);
    }
}

vec3 three(float six[6], int from) { return vec3(six[from], six[from + 1], six[from + 2]); }

// Adds the operator product of a core's joints to the core's rows. The two bodies of a joint are its sides, 0 and 1.
void add_joints(Rigid rigid, inout vec3 force, inout vec3 torque) {
    for (uint k = rigid.joint_first; k < rigid.joint_first + rigid.joint_count; k++) {
        uint joint = joint_sides[k] / 2, side = joint_sides[k] % 2;
        for (uint from = 0; from < 2; from++) {
            uint other = joints[joint].rigid[from];
            if (other == NONE) continue;
            RigidIterate now = iterates[(MODE == GATHER_LOOP ? set : solve.current) * RIGIDS + other];
            float p[6] = MODE == GATHER_LOOP ? now.u : now.x;
            add_joint(joint, side, from, three(p, 0), three(p, 3), force, torque);
        }
    }
}

// Upper bound of e . M^-1 e, where e is the error that rounding of x causes in the core's joints to cores with a
// greater index and to bodies whose motion is prescribed. Joints respond to small differences of twists, through
// J^T G J, with G the joints' stiffness and J the map from twists to these differences. M contains J^T G J, so
// J M^-1 J^T <= G^-1.
float lost_in_joints(uint index, Rigid rigid) {
    float sum = 0.0;
    for (uint k = rigid.joint_first; k < rigid.joint_first + rigid.joint_count; k++) {
        uint joint = joint_sides[k] / 2, other = joints[joint].rigid[1 - joint_sides[k] % 2];
        if (other < index) continue;
        vec2 lost = vec2(0.0);
        for (uint side = 0; side < 2; side++) {
            if (joints[joint].rigid[side] == NONE) continue;
            float x[6] = iterates[solve.current * RIGIDS + joints[joint].rigid[side]].x;
            lost += HALF_ULP * vec2(length(three(x, 0)) + length(cross(three(x, 3), joints[joint].arm[side])), length(three(x, 3)));
        }
        float w[6] = joints[joint].angular;
        sum += joints[joint].linear * lost.x * lost.x + (w[0] + w[1] + w[2]) * lost.y * lost.y;
    }
    return sum;
}

// Computes w at the nodes of a block, and adds their part of the inner products and of P^T w and P^T r, in world axes.
void gather_block(uint b, inout vec3 sums, inout CoarseVector of_product, inout CoarseVector of_residual) {
    Block block = block_of(b);
    vec4 place = fetch(block_places, b), turn = fetch(block_turns, b);
    for (uint at = gl_LocalInvocationID.x; at < block.count; at += SIZE) {
        uvec4 node = block_node(block, at);
        uint i = node.x;
        vec4 rest = fetch(node_rest, i);
        vec3 p = fetch(change, i).xyz;
        vec3 w = (rest.w + params.dt * node_damping(node)) * p;
        if (ASSEMBLED) w += gather_row(p, node.y, node.z);
        else w += gather_elements(node.y, node.z);
        if (CONTACT) w += gather_contacts(node.x);
        if (SUPPORTS && ROLE == FREE_NODES) {
            vec3 along = along_support(supported[i].left, w);
            if (MODE == GATHER_END) supported[i].impulse = w - along - supported[i].taken;
            w = along;
        }
        operator_product[i] = vec4(w, 0.0);
        if (ROLE == ATTACHED_NODES) {
            of_product.c0 += w;
            of_product.c1 += cross(rotate(turn, rest.xyz), w);
            if (MODE == GATHER_LOOP) sums.y += dot(w, p);
            continue;
        }
        vec3 r = vec3(0.0);
        if (MODE == GATHER_WARM_START) {
            sums += vec3(dot(p, fetch(residual_or_rhs, i).xyz), dot(p, w), dot(fetch(trend, i).xyz, w));
        } else if (MODE == GATHER_LOOP) {
            r = fetch(residual_or_rhs, i).xyz;
            sums.xy += vec2(dot(r, p), dot(w, p));
        } else {
            r = fetch(residual_or_rhs, i).xyz - w;
            vec3 lost = HALF_ULP * p, e = lost / fetch(inverse, 2 * i).xyz;
            sums.xy += vec2(dot(r, precondition_node(i, r)), dot(lost, e));
            vec3 on_modes = SMOOTHS && COARSE ? product_without_contacts(i, lost) : e;
            if (COARSE) sums.z += dot(on_modes, on_modes);
        }
        if (COARSE) {
            vec3 where = (rest.xyz - place.xyz) * place.w;
            if (MODE != GATHER_END) add_restriction(of_product, force_on_modes(i, w), where);
            if (MODE != GATHER_WARM_START) add_restriction(of_residual, force_on_modes(i, r), where);
        }
    }
    if (ROLE != ATTACHED_NODES) return;
    Rigid rigid = rigids[block.rigid];
    uint held = held_index(block.rigid);
    if (held != NONE && b == rigid.block_first && gl_LocalInvocationID.x == 0) {
        // The product of the virtual coupling (spring and damper to the haptic device), in the rows of the held core.
        RigidIterate now = iterates[(MODE == GATHER_LOOP ? set : solve.current) * RIGIDS + block.rigid];
        float p[6] = MODE == GATHER_LOOP ? now.u : now.x, own[6] = times(params.held[held].matrix, p);
        of_product.c0 += three(own, 0);
        of_product.c1 += three(own, 3);
        if (MODE == GATHER_LOOP) sums.y += inner(own, p);
    }
    if (JOINTS && b == rigid.block_first && gl_LocalInvocationID.x == 0) {
        vec3 force = vec3(0.0), torque = vec3(0.0);
        add_joints(rigid, force, torque);
        of_product.c0 += force;
        of_product.c1 += torque;
        if (MODE == GATHER_LOOP) {
            float p[6] = iterates[set * RIGIDS + block.rigid].u;
            sums.y += dot(force, three(p, 0)) + dot(torque, three(p, 3));
        }
        if (MODE == GATHER_END) sums.y += lost_in_joints(block.rigid, rigid);
    }
    follow(rigid.hinge, of_product.c0, of_product.c1);
    if (MODE == GATHER_END) of_residual = CoarseVector(-of_product.c0, -of_product.c1, vec3(0.0), vec3(0.0));
    if (gl_LocalInvocationID.x != 0 || b != rigid.block_first) return;
    if (MODE == GATHER_LOOP) {
        RigidIterate now = iterates[set * RIGIDS + block.rigid];
        sums.x += inner(now.r, now.u);
        of_residual = CoarseVector(three(now.r, 0), three(now.r, 3), vec3(0.0), vec3(0.0));
    } else if (MODE == GATHER_END) {
        of_residual.c0 += three(rigid.b, 0);
        of_residual.c1 += three(rigid.b, 3);
    }
}

// Computes w in the tool's rows, from contacts and, in an iteration, from inertia and coupling, which lane 0 adds.
void gather_tool(inout vec3 sums, inout CoarseVector of_product) {
    CoarseVector rows = coarse_zero();
    if (CONTACT) add_tool_contacts(counts.contacts, rows.c0, rows.c1);
    of_product = rows;
    if (MODE != GATHER_LOOP) return;
    RigidIterate now = iterates[set * RIGIDS + RIGIDS - 1];
    sums.y = dot(rows.c0, three(now.u, 0)) + dot(rows.c1, three(now.u, 3));
    if (gl_LocalInvocationID.x != 0) return;
    float own[6] = times(params.tool_matrix, now.u);
    of_product.c0 += three(own, 0);
    of_product.c1 += three(own, 3);
    sums.xy += vec2(inner(now.r, now.u), inner(own, now.u));
}

void main() {
    uint b = ROLE == TOOL_ROWS ? BLOCKS : FIRST + gl_WorkGroupID.x;
    vec3 sums = vec3(0.0);
    CoarseVector of_product = coarse_zero(), of_residual = coarse_zero();
    if (ROLE == TOOL_ROWS) gather_tool(sums, of_product);
    else gather_block(b, sums, of_product, of_residual);
    vec4 w[3] = packed(of_product), r[3] = packed(of_residual);
    vec4 totals[SUMS] = vec4[SUMS](vec4(sums, 0.0), w[0], w[1], w[2], r[0], r[1], r[2]);
    workgroup_sums(totals, COARSE && ROLE != TOOL_ROWS ? 7 : (ROLE == FREE_NODES ? 1 : 4));
    if (gl_LocalInvocationID.x != 0) return;
    vec2 products = totals[0].xy;
    if (MODE == GATHER_WARM_START) projections[b] = totals[0];
    if (ROLE == FREE_NODES && !COARSE) {
        if (MODE != GATHER_WARM_START) dots[b] = products;
        return;
    }
    uint coarse_index = ROLE == TOOL_ROWS ? BLOCKS : coarse_index_of(b);
    if (MODE == GATHER_END && COARSE && ROLE == FREE_NODES) products.y += coarse_share(coarse_index) * totals[0].z;
    if (MODE != GATHER_WARM_START) dots[b] = products;
    vec4 turn = ROLE == TOOL_ROWS ? vec4(0.0, 0.0, 0.0, 1.0) : fetch(block_turns, b);
    w = packed(to_frame(unpacked(totals[1], totals[2], totals[3]), turn));
    r = packed(to_frame(unpacked(totals[4], totals[5], totals[6]), turn));
    for (int k = 0; k < 3; k++) {
        restricted_product[3 * coarse_index + k] = w[k];
        if (COARSE && MODE != GATHER_WARM_START) restricted_residual[3 * coarse_index + k] = r[k];
    }
}
