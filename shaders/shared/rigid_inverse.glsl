// The preconditioner of rigid bodies. The n bodies of a group that joints connect have one block, of which
// `rigid_inverses` holds the 6 n x 6 n inverse by rows; solve/cores and solve/first_residual write it. Needs `rigids`.

// Where row `i` of a rigid body begins in `rigid_inverses`. Its product with the residuals of all bodies of the group,
// six each in their order, is row i of M^-1 r.
uint inverse_row(uint index, uint i) {
    Rigid own = rigids[index];
    return own.inverse_first + 6 * own.group_count * (6 * (index - own.group_first) + i);
}
