// What rounding, which is independent from node to node, makes of the coarse level's part of a norm. Needs `coarse_scales`.

// Of the sum of e.e over a slot's nodes: the coarse inverse's diagonal, whose roots the scales are; an axis has a third of
// the modes.
float coarse_share(uint slot) {
    float share = 0.0;
    for (uint k = 0; k < 3; k++) {
        vec4 scale = fetch(coarse_scales, 3 * slot + k);
        share += dot(scale, scale) / 3.0;
    }
    return share;
}
