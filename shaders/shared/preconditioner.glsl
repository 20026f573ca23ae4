// The preconditioner M of conjugate gradients for the operator A: z = M^-1 r at a free node, one whose motion the
// solver finds. First, z = D^-1 r, with D the node's 3x3 diagonal block of A (block Jacobi). Where the body has a
// coarse space, P A_c^-1 P^T r is added, with P the prolongation from that space and A_c its Galerkin matrix (two-level
// additive Schwarz, Dryja and Widlund 1987); solve/coarse and solve/update compute A_c^-1 P^T r. Rigid bodies have
// another preconditioner, in shared/rigid_inverse.glsl. An including shader includes shared/symmetric.glsl and
// shared/coarse_vector.glsl, and declares COARSE (whether any body has a coarse space) and `inverse` (D^-1 of each
// node: a vec4 with xx yy zz and a vec4 with xy xz yz).

// D^-1 r.
vec3 precondition_node(uint node, vec3 r) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, r);
}

// M^-1 r of a free node. `coarse` is A_c^-1 P^T r for the node's block (set of nodes that one workgroup works on), in
// world axes; `at` is the node's rest position from the middle of the block, divided by the block's size.
vec3 precondition(uint node, vec3 r, CoarseVector coarse, vec3 at) {
    vec3 z = precondition_node(node, r);
    if (COARSE) z += prolongation(coarse, at);
    return z;
}
