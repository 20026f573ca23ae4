// The preconditioner of rigid bodies: the inverse of the block of a group that joints join, 6 n x 6 n by rows (solve/cores and
// solve/start write it). Needs `rigids`.

// Where row `i` of a body begins among `rigid_inverses`; M^-1 r there is its product with the six residuals of each body of
// the group, in their order.
uint inverse_row(uint index, uint i) {
    Rigid own = rigids[index];
    return own.inverse_first + 6 * own.group_count * (6 * (index - own.group_first) + i);
}
