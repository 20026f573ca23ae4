// The solver's preconditioner M for rigid bodies. A group is the n rigid bodies that joints connect. `rigid_inverses`
// holds for each group the inverse of its 6 n x 6 n diagonal block of the operator, row by row; solve/cores and
// solve/first_residual write these inverses. An including shader declares `rigids`.

// Index at which row `i` (0 to 5) of the rigid body `index` begins in `rigid_inverses`. The product of this row with
// the residuals r of all bodies of the group, six numbers for each body in order, is the body's row i of M^-1 r.
uint inverse_row(uint index, uint i) {
    Rigid own = rigids[index];
    return own.inverse_first + 6 * own.group_count * (6 * (index - own.group_first) + i);
}
