// The part of e . M^-1 e that comes from the coarse space of the solver's preconditioner M, for rounding errors e that
// are independent from node to node. This part is e . P A_c^-1 P^T e, with the prolongation P from the coarse space to
// the nodes and the Galerkin matrix A_c of the coarse space (shared/preconditioner.glsl). A block is a set of nodes
// that one workgroup works on; modes, the basis of the coarse space, are the twelve affine motions of a block. An
// including shader declares `coarse_scales`, the square roots of the diagonal of A_c^-1.

// Estimate of e . P A_c^-1 P^T e for a block, relative to the sum of e . e over its nodes: one third of the trace of
// A_c^-1 over the block's modes, because each mode moves nodes along one of the three axes. `coarse_index` is the index
// of the block's modes (coarse_index_of).
float coarse_share(uint coarse_index) {
    float share = 0.0;
    for (uint k = 0; k < 3; k++) {
        vec4 scale = fetch(coarse_scales, 3 * coarse_index + k);
        share += dot(scale, scale) / 3.0;
    }
    return share;
}
