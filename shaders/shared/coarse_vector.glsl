// Modes are the basis of the preconditioner's coarse space: twelve motions for each block (set of nodes that one
// workgroup works on). Free nodes of a block move as R (c0 + c1 x + c2 y + c3 z), where (x, y, z) is a node's rest
// position relative to the middle of the block, divided by the block's size, and R is the block's rotation
// (solve/assemble). Nodes attached to a core (rigid body inside a soft body) move with the velocity R c0 and the
// angular velocity R c1, with R the core's rotation. A block's twelve numbers lie in three texels: c0 c1.x, c1.yz
// c2.xy, c2.z c3.

struct CoarseVector {
    vec3 c0, c1, c2, c3;
};

CoarseVector coarse_zero() { return CoarseVector(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)); }

// Restriction P_0^T: adds the force v on a node at (x, y, z) = `at` to the twelve sums of the node's block.
void add_restriction(inout CoarseVector coarse_vector, vec3 v, vec3 at) {
    coarse_vector.c0 += v;
    coarse_vector.c1 += v * at.x;
    coarse_vector.c2 += v * at.y;
    coarse_vector.c3 += v * at.z;
}

// Prolongation P_0: velocity of a node at (x, y, z) = `at` for the coefficients c0 to c3, in the block's axes.
vec3 prolongation(CoarseVector m, vec3 at) { return m.c0 + m.c1 * at.x + m.c2 * at.y + m.c3 * at.z; }

vec4[3] packed(CoarseVector m) { return vec4[3](vec4(m.c0, m.c1.x), vec4(m.c1.yz, m.c2.xy), vec4(m.c2.z, m.c3)); }

CoarseVector unpacked(vec4 a, vec4 b, vec4 c) { return CoarseVector(a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw); }

CoarseVector to_frame(CoarseVector m, vec4 q) {
    return CoarseVector(rotate_back(q, m.c0), rotate_back(q, m.c1), rotate_back(q, m.c2), rotate_back(q, m.c3));
}

CoarseVector to_world(CoarseVector m, vec4 q) {
    return CoarseVector(rotate(q, m.c0), rotate(q, m.c1), rotate(q, m.c2), rotate(q, m.c3));
}
