// Modes: the basis of the coarse space of the preconditioner, for each block of nodes (one workgroup). Free nodes of a
// block move as R (c0 + c1 x + c2 y + c3 z), where (x, y, z) is a node's rest position from the middle of the block
// over the block's size, and R the block's rotation (solve/assemble). Nodes attached to a core move by its twist,
// (R c0, R c1), R the core's rotation. A block has twelve numbers, in three texels: c0 c1.x, c1.yz c2.xy, c2.z c3.

struct CoarseVector {
    vec3 c0, c1, c2, c3;
};

CoarseVector coarse_zero() { return CoarseVector(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)); }

// Restriction: adds a node's force v, at (x, y, z) = `at`, to the sums of its block over the modes.
void add_restriction(inout CoarseVector coarse_vector, vec3 v, vec3 at) {
    coarse_vector.c0 += v;
    coarse_vector.c1 += v * at.x;
    coarse_vector.c2 += v * at.y;
    coarse_vector.c3 += v * at.z;
}

// Prolongation: velocity that the modes give to a node at (x, y, z) = `at`, in the axes of c0 to c3.
vec3 prolongation(CoarseVector m, vec3 at) { return m.c0 + m.c1 * at.x + m.c2 * at.y + m.c3 * at.z; }

vec4[3] packed(CoarseVector m) { return vec4[3](vec4(m.c0, m.c1.x), vec4(m.c1.yz, m.c2.xy), vec4(m.c2.z, m.c3)); }

CoarseVector unpacked(vec4 a, vec4 b, vec4 c) { return CoarseVector(a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw); }

CoarseVector to_frame(CoarseVector m, vec4 q) {
    return CoarseVector(rotate_back(q, m.c0), rotate_back(q, m.c1), rotate_back(q, m.c2), rotate_back(q, m.c3));
}

CoarseVector to_world(CoarseVector m, vec4 q) {
    return CoarseVector(rotate(q, m.c0), rotate(q, m.c1), rotate(q, m.c2), rotate(q, m.c3));
}
