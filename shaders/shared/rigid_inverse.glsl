// The preconditioner of rigid bodies. A group is the n rigid bodies that joints connect. `rigid_inverses` holds for
// each group, by rows, the inverse of its 6 n x 6 n block of the operator; solve/cores and solve/first_residual write
// it. An including shader declares `rigids`.

// Index at which row `i` of a rigid body begins in `rigid_inverses`. The product of this row with the residuals of all
// bodies of the group, six numbers each in their order, is row i of M^-1 r.
uint inverse_row(uint index, uint i) {
    Rigid own = rigids[index];
    return own.inverse_first + 6 * own.group_count * (6 * (index - own.group_first) + i);
}
