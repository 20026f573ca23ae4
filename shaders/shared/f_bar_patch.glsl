// F-bar patches: groups of tetrahedra that share one volumetric strain (elastic/mean_dilatation). A patch adds c c^T to
// the solver's operator. Its row c has one vector for each node of the patch: the scaled gradient of the shared strain
// with respect to the node's displacement. These functions give the places of a patch's nodes, of the vectors of its
// row and of its forces in their arrays, where the k-th entries of all patches are adjacent. An including shader
// declares `patch_nodes` and the numbers PATCHES and TETRAHEDRA.

const uint PATCH_NODES = 12;  // most nodes of a patch
const uint PATCH_TETRAHEDRA = 12;  // most tetrahedra of a patch

// Four of the nodes of patch p; q is 0, 1 or 2.
uvec4 patch_quad(uint p, uint q) {
    return fetch(patch_nodes, PATCHES * q + p);
}

// Index of the vector of a patch's row that belongs to its k-th node.
uint patch_row(uint p, uint k) {
    return PATCHES * k + p;
}

// Index of the force on a patch's k-th node in `element_forces`, after four forces for each tetrahedron and four
// zero vectors that stand for no tetrahedron.
uint patch_entry(uint p, uint k) {
    return 4 * (TETRAHEDRA + 1) + patch_row(p, k);
}
