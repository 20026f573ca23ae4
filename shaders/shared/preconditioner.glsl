// The preconditioner of conjugate gradients, z = M^-1 r, at a free node: D^-1 r, with D the node's 3x3 diagonal block
// of A (block Jacobi). Where the body has a coarse space, P A_c^-1 P^T r is added, with P the prolongation from that
// space and A_c its Galerkin matrix (two-level additive Schwarz, Dryja and Widlund 1987), which solve/coarse and
// solve/update compute. Rigid bodies have another preconditioner, in shared/rigid_inverse.glsl. An including shader
// includes shared/symmetric.glsl and shared/coarse_vector.glsl, and declares COARSE and `inverse` (D^-1, two texels for
// each node, as in shared/symmetric.glsl).

// D^-1 r.
vec3 precondition_node(uint node, vec3 r) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, r);
}

// M^-1 r of a free node. `coarse` is A_c^-1 P^T r of its block, world axes; `at` is its scaled rest position in the
// block.
vec3 precondition(uint node, vec3 r, CoarseVector coarse, vec3 at) {
    vec3 z = precondition_node(node, r);
    if (COARSE) z += prolongation(coarse, at);
    return z;
}
