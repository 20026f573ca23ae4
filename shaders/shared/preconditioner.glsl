// The preconditioner of conjugate gradients, z = M^-1 r. For a free node z is D^-1 r, D its 3x3 diagonal block of A
// (block Jacobi); with a coarse space P A_c^-1 P^T r is added (two-level additive Schwarz, Dryja and Widlund 1987),
// which solve/coarse and solve/update compute. Rigid bodies have the inverse of their group's block
// (shared/rigid_inverse.glsl). Needs `inverse` (D^-1, two texels a node, as in shared/symmetric.glsl),
// shared/symmetric.glsl, shared/coarse_vector.glsl and COARSE.

// D^-1 r.
vec3 precondition_node(uint node, vec3 r) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, r);
}

// M^-1 r of a free node; `coarse`: A_c^-1 P^T r of its block, world axes; `at`: its position in the block's modes.
vec3 precondition(uint node, vec3 r, CoarseVector coarse, vec3 at) {
    vec3 z = precondition_node(node, r);
    if (COARSE) z += prolongation(coarse, at);
    return z;
}
