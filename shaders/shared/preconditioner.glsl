// The preconditioner, z = M^-1 r: of a free node D^-1 r, D its 3x3 diagonal block of A, and with a coarse level
// P A_c^-1 P^T r besides (two-level additive Schwarz; solve/coarse and solve/update make the modes). Rigid bodies have the
// inverse of their group's block (shared/rigid_inverse.glsl). Needs `inverse` (two a node, as shared/symmetric.glsl has them),
// shared/symmetric.glsl, shared/modes.glsl and COARSE.

// D^-1 r.
vec3 precondition_node(uint node, vec3 r) {
    return symmetric_times(fetch(inverse, 2 * node).xyz, fetch(inverse, 2 * node + 1).xyz, r);
}

// M^-1 r of a free node; `coarse`: A_c^-1 P^T r of its block, world axes, `at`: the node's place among its modes.
vec3 precondition(uint node, vec3 r, Modes coarse, vec3 at) {
    vec3 z = precondition_node(node, r);
    if (COARSE) z += moved_by(coarse, at);
    return z;
}
