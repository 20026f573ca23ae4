// Coarse part of e . M^-1 e, with the preconditioner M (shared/preconditioner.glsl), for rounding errors e that are
// independent from node to node. An including shader declares `coarse_scales`.

// Estimate of e . P A_c^-1 P^T e for a block of nodes, relative to the sum of e . e over its nodes: one third of the
// trace of A_c^-1 over the block's modes, because each mode moves nodes along one of the three axes.
// `coarse_index` is the index of the block's modes (coarse_index_of).
float coarse_share(uint coarse_index) {
    float share = 0.0;
    for (uint k = 0; k < 3; k++) {
        vec4 scale = fetch(coarse_scales, 3 * coarse_index + k);
        share += dot(scale, scale) / 3.0;
    }
    return share;
}
