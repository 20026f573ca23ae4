// The preconditioner M of conjugate gradients for the operator A: z = M^-1 r at a free node, one whose motion the
// solver finds. First, z = D^-1 r, with D the node's 3x3 diagonal block of A (block Jacobi). Where the body has a
// coarse space, P A_c^-1 P^T r is added, with P the prolongation from that space and A_c its Galerkin matrix
// (two-level additive Schwarz, Dryja and Widlund 1987); solve/coarse and solve/update compute A_c^-1 P^T r. A_c is
// that of the body at rest, without contacts. A contact would resist motions that A_c does not know to be stiff. So P
// = D^-1 E P_0 at a free node: the affine motions P_0 of shared/coarse_vector.glsl, smoothed by one step of block
// Jacobi on the nodes' diagonal blocks of the contacts' part of A. E is D without that part; where a contact is
// stiff, D^-1 E leaves no motion along its normal. Supports (shared/support.glsl) count like infinitely stiff contacts:
// with the projection S onto what they leave, D is S D S and E is S E S, but that D is filled up where it would be
// singular. Without contacts and supports P is P_0.
//
// Rigid bodies have another preconditioner, in shared/rigid_inverse.glsl. An including shader includes
// shared/symmetric.glsl and shared/coarse_vector.glsl, and declares SMOOTHS (whether P differs from P_0), COARSE (whether
// any body has a coarse space), `inverse` (D^-1 of each node: a vec4 with xx yy zz and a vec4 with xy xz yz) and
// `blocks_without_contacts` (E, likewise).

// D^-1 r.
vec3 precondition_node(uint node, vec3 r) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, r);
}

// E v.
vec3 product_without_contacts(uint node, vec3 v) {
    return symmetric_times(
        fetch(blocks_without_contacts, 2 * node).xyz, fetch(blocks_without_contacts, 2 * node + 1).xyz, v);
}

// E D^-1 r, whose restriction by P_0^T is P^T r.
vec3 force_on_modes(uint node, vec3 r) {
    return SMOOTHS ? product_without_contacts(node, precondition_node(node, r)) : r;
}

// M^-1 r of a free node. `coarse` is A_c^-1 P^T r for the node's block (set of nodes that one workgroup works on), in
// world axes; `at` is the node's rest position from the middle of the block, divided by the block's size.
vec3 precondition(uint node, vec3 r, CoarseVector coarse, vec3 at) {
    if (!COARSE) return precondition_node(node, r);
    vec3 moved = prolongation(coarse, at);
    if (SMOOTHS) return precondition_node(node, r + product_without_contacts(node, moved));
    return precondition_node(node, r) + moved;
}
