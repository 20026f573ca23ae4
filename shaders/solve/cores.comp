#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/finite.glsl"
#include "shared/rotation.glsl"

// Solve: preconditioner and right-hand side of dynamic cores (rigid bodies inside soft ones, whose motion the solver
// finds). One workgroup runs for each core, and does nothing unless the core is the first of its group (the cores that
// joints connect). The f64 reference is oracle::step.
//
// A core's diagonal block is approximated by sum P_i^T D_i P_i over the nodes i attached to the core, with D_i the
// node's diagonal block of the operator and P_i the map from the core's twist to the node's velocity; the coupling
// between these nodes is left out. To this sum are added the terms of the core's joints and, if the haptic device holds
// the core, of the virtual coupling (spring and damper to the device). Joints are stiffer than what they connect, so
// the preconditioner inverts as a whole the matrix A of a group: such blocks, and the blocks of joints between cores.
// Joints form trees, in which elimination from the leaves to the root causes no fill-in. The inverse A^-1 is then
// computed from the root to the leaves: for a core c with parent p, A_cp the block of A between c and p, S_c the Schur
// complement of c after the elimination of its children, T_c = S_c^-1 A_cp, and cores j numbered before c,
//   A^-1_cj = -T_c A^-1_pj,  A^-1_cc = S_c^-1 - A^-1_cp T_c^T.
// For a core on a hinge S_c is inverted for the rotation about the hinge's axis alone.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const bool JOINTS = false;
layout(constant_id = 2) const bool LOADS = false;
layout(constant_id = 3) const uint NODES = 0;               // number of nodes, behind which external_forces has the cores
layout(constant_id = 13) const uint HELD = 0;               // number of cores that haptic devices hold

layout(scalar) uniform Params { StepParams params; };
layout(scalar) readonly buffer Frames { Frame frames[]; };
READ_ONLY(uvec4, block_nodes);
READ_ONLY(vec4, node_rest);
READ_ONLY(vec4, external_forces);      // loads on nodes, then force and torque on each dynamic core (elastic/loads)
READ_ONLY(vec4, rhs);
READ_ONLY(vec4, inverse);              // of attached nodes: their diagonal blocks, not inverted
READ_ONLY(vec4, restricted_rhs);       // restriction of b (shared/coarse_vector.glsl), three texels per block of nodes
layout(scalar) readonly buffer Joints { Joint joints[]; };
layout(scalar) readonly buffer JointSides { uint joint_sides[]; };     // joints of each core: 2 * joint + side (0, 1)
layout(scalar) coherent buffer Rigids { Rigid rigids[]; };
layout(scalar) coherent buffer RigidBlocks { float rigid_blocks[]; };      // of each core: S, later S^-1, and then T
layout(scalar) coherent buffer RigidInverses { float rigid_inverses[]; };

#include "shared/six.glsl"
#include "shared/symmetric.glsl"
#include "shared/sum.glsl"
#include "shared/settle.glsl"
#include "shared/core.glsl"
#include "shared/held.glsl"
#include "shared/joint.glsl"
#include "shared/twist.glsl"
TWIST_OF(restricted_rhs)

// Diagonal block of an attached node times a vector.
vec3 block_times(uint node, vec3 v) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, v);
}

// P (P^T B P)^-1 P^T for a 6x6 block B, where P maps a spin about `axis` to a twist; returns false if there is no
// inertia about that axis.
bool invert_about(vec3 axis, float block[36], out float inverse[36]) {
    float moment = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) moment += axis[i] * block[6 * (3 + i) + 3 + k] * axis[k];
    }
    for (int k = 0; k < 36; k++) inverse[k] = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) inverse[6 * (3 + i) + 3 + k] = axis[i] * axis[k] / moment;
    }
    return moment > 0.0;
}

// Adds the 6x6 block of a joint between the twist of its body `from` and the rows of its body `to`, column by column.
// The two bodies of a joint are its sides, 0 and 1.
void add_joint_block(uint joint, uint to, uint from, inout float block[36]) {
    for (int j = 0; j < 6; j++) {
        vec3 axis = vec3(j % 3 == 0, j % 3 == 1, j % 3 == 2), force = vec3(0.0), torque = vec3(0.0);
        add_joint(joint, to, from, j < 3 ? axis : vec3(0.0), j < 3 ? vec3(0.0) : axis, force, torque);
        for (int i = 0; i < 3; i++) {
            block[6 * i + j] += force[i];
            block[6 * (3 + i) + j] += torque[i];
        }
    }
}

// Writes a core's diagonal block and right-hand side, and to its `operator_product` the sums of the magnitudes of the
// right-hand side's terms.
void assemble(uint c) {
    Rigid core = rigids[c];
    vec4 turn = frames[core.frame].rotation;
    float block[36];
    for (int k = 0; k < 36; k++) block[k] = 0.0;
    vec3 force_size = vec3(0.0), torque_size = vec3(0.0);
    for (uint k = gl_LocalInvocationID.x; k < core.node_count; k += SIZE) {
        uint node = fetch(block_nodes, core.node_first + k).x;
        vec3 arm = arm_of(node, turn);
        vec3 f = fetch(rhs, node).xyz;
        force_size += abs(f);
        torque_size += abs(cross(arm, f));
        for (int j = 0; j < 6; j++) {
            vec3 axis = vec3(j % 3 == 0, j % 3 == 1, j % 3 == 2);
            vec3 moved = block_times(node, j < 3 ? axis : cross(axis, arm));
            vec3 turned = cross(arm, moved);
            for (int i = 0; i < 3; i++) {
                block[6 * i + j] += moved[i];
                block[6 * (3 + i) + j] += turned[i];
            }
        }
    }
    for (int k = 0; k < 36; k += 4) {
        vec4 part = workgroup_sum(vec4(block[k], block[k + 1], block[k + 2], block[k + 3]));
        for (int l = 0; l < 4; l++) block[k + l] = part[l];
    }
    force_size = workgroup_sum(vec4(force_size, 0.0)).xyz;
    torque_size = workgroup_sum(vec4(torque_size, 0.0)).xyz;
    if (gl_LocalInvocationID.x != 0) return;
    uint held = held_index(c);
    if (held != NONE) {
        for (int k = 0; k < 36; k++) block[k] += params.held[held].matrix[k];
        float rows[6] = params.held[held].rhs;
        force_size += abs(vec3(rows[0], rows[1], rows[2]));
        torque_size += abs(vec3(rows[3], rows[4], rows[5]));
    }
    if (LOADS) {
        force_size += abs(params.dt * fetch(external_forces, NODES + 2 * c).xyz);
        torque_size += abs(params.dt * fetch(external_forces, NODES + 2 * c + 1).xyz);
    }
    for (uint k = 0; JOINTS && k < core.joint_count; k++) {
        uint joint = joint_sides[core.joint_first + k] / 2, side = joint_sides[core.joint_first + k] % 2;
        add_joint_block(joint, side, side, block);
        vec3 force = vec3(0.0), torque = vec3(0.0);
        add_springs(joint, side, force, torque);
        force_size += abs(force);
        torque_size += abs(torque);
    }
    for (int k = 0; k < 36; k++) rigid_blocks[CORE_NUMBERS * c + k] = block[k];
    rigids[c].b = twist_of_restricted_rhs(core.first_coarse_index, core.block_count, turn);
    rigids[c].operator_product =
        float[6](force_size.x, force_size.y, force_size.z, torque_size.x, torque_size.y, torque_size.z);
}

// Eliminates core c after its children: writes S_c^-1 and T_c, and updates the parent's block. For a single invocation.
void eliminate(uint c) {
    Rigid core = rigids[c];
    float block[36], inverse_block[36];
    for (int k = 0; k < 36; k++) block[k] = rigid_blocks[CORE_NUMBERS * c + k];
    bool hinged = core.hinge != vec3(0.0);
    // Where the block is singular in f32 the inverse becomes NaN, so that the step is rejected and a flag reports it.
    if (!(hinged ? invert_about(core.hinge, block, inverse_block) : invert(block, inverse_block)))
        inverse_block[0] = uintBitsToFloat(0x7fc00000u);
    for (int k = 0; k < 36; k++) rigid_blocks[CORE_NUMBERS * c + k] = inverse_block[k];
    if (!JOINTS || core.parent == NONE) return;
    float across[36];
    for (int k = 0; k < 36; k++) across[k] = 0.0;
    for (uint k = 0; k < core.joint_count; k++) {
        uint joint = joint_sides[core.joint_first + k] / 2, side = joint_sides[core.joint_first + k] % 2;
        if (joints[joint].rigid[1 - side] == core.parent) add_joint_block(joint, side, 1 - side, across);
    }
    for (int j = 0; j < 6; j++) {
        float column[6];
        for (int i = 0; i < 6; i++) column[i] = across[6 * i + j];
        column = times(inverse_block, column);
        for (int i = 0; i < 6; i++) {
            rigid_blocks[CORE_NUMBERS * c + 36 + 6 * i + j] = column[i];
            float taken = 0.0;
            for (int l = 0; l < 6; l++) taken += across[6 * l + i] * column[l];
            rigid_blocks[CORE_NUMBERS * core.parent + 6 * i + j] -= taken;
        }
    }
}

// Writes the rows and columns of core c into the inverse of its group, which is `count` cores from index `first` on and
// whose inverse begins at `base`. The rows and columns of the cores before c have been written.
void spread(uint c, uint first, uint count, uint base) {
    uint width = 6 * count, row = 6 * (c - first);
    uint parent_row = JOINTS ? 6 * (rigids[c].parent - first) : 0;
    bool hangs = JOINTS && rigids[c].parent != NONE;
    for (uint k = gl_LocalInvocationID.x; hangs && k < 6 * row; k += SIZE) {
        uint i = k % 6, j = k / 6;
        float sum = 0.0;
        for (uint l = 0; l < 6; l++) {
            sum -= rigid_blocks[CORE_NUMBERS * c + 36 + 6 * i + l] * rigid_inverses[base + (parent_row + l) * width + j];
        }
        rigid_inverses[base + (row + i) * width + j] = sum;
        rigid_inverses[base + j * width + row + i] = sum;
    }
    settle();
    for (uint k = gl_LocalInvocationID.x; k < 36; k += SIZE) {
        uint i = max(k / 6, k % 6), j = min(k / 6, k % 6);
        float sum = rigid_blocks[CORE_NUMBERS * c + 6 * i + j];
        for (uint l = 0; hangs && l < 6; l++) {
            sum -= rigid_inverses[base + (row + i) * width + parent_row + l] * rigid_blocks[CORE_NUMBERS * c + 36 + 6 * j + l];
        }
        rigid_inverses[base + (row + k / 6) * width + row + k % 6] = sum;
    }
    settle();
}

void main() {
    uint first = rigids[gl_WorkGroupID.x].group_first, count = rigids[gl_WorkGroupID.x].group_count;
    if (gl_WorkGroupID.x != first) return;
    for (uint c = first; c < first + count; c++) assemble(c);
    for (uint k = count; k > 0 && gl_LocalInvocationID.x == 0; k--) eliminate(first + k - 1);
    settle();
    uint base = rigids[first].inverse_first;
    for (uint c = first; c < first + count; c++) spread(c, first, count, base);
    for (uint k = gl_LocalInvocationID.x; k < count; k += SIZE) {
        float rounding = 0.0, e[6] = rigids[first + k].operator_product;
        for (uint i = 0; i < 6; i++) rounding += e[i] * (e[i] * rigid_inverses[base + (6 * k + i) * (6 * count + 1)]);
        rigids[first + k].rounding = rounding;
    }
}
