// Products with the solver's operator A and its preconditioner M in the six equations (rows) of a rigid body: a dynamic
// core (rigid body inside a soft one, whose motion the solver finds), or the tool (the body that the haptic device
// leads). An including shader declares `params`, `frames`, `rigids`, `rigid_inverses`, `iterates`, `solve`,
// `restricted_product`, BLOCKS (number of blocks, the sets of nodes that one workgroup works on), RIGIDS (number of
// rigid bodies) and TOOL (whether the last of them is the tool), and includes shared/rotation.glsl, shared/twist.glsl,
// shared/six.glsl and shared/rigid_inverse.glsl.

// Operator product A x in the rows of a rigid body, with x the newest iterate.
float[6] product_of(uint index) {
    bool is_tool = TOOL && index == RIGIDS - 1;
    uint first = is_tool ? BLOCKS : rigids[index].first_coarse_index, count = is_tool ? 1 : rigids[index].block_count;
    vec4 turn = is_tool ? vec4(0.0, 0.0, 0.0, 1.0) : frames[rigids[index].frame].rotation;
    float y[6] = twist_of_restricted_product(first, count, turn);
    if (is_tool) {
        float own[6] = times(params.tool_matrix, iterates[solve.current * RIGIDS + index].x);
        for (int k = 0; k < 6; k++) y[k] += own[k];
    }
    return y;
}

// The six rows of a rigid body in M^-1 y. The vector y consists of the right-hand sides `b` of all bodies of the rigid
// body's group (the rigid bodies that joints connect), or, if `of_residual`, of their `operator_product`, which then holds
// the residual b - A x.
float[6] preconditioned_rows(uint index, bool of_residual) {
    uint first = rigids[index].group_first, count = rigids[index].group_count, row = inverse_row(index, 0);
    float z[6] = float[6](0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (uint k = 0; k < count; k++) {
        for (uint j = 0; j < 6; j++) {
            float v = of_residual ? rigids[first + k].operator_product[j] : rigids[first + k].b[j];
            for (uint i = 0; i < 6; i++) z[i] += rigid_inverses[row + 6 * (count * i + k) + j] * v;
        }
    }
    return z;
}
