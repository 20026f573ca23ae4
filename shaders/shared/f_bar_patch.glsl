// F-bar patches: groups of tetrahedra that share one volumetric strain (elastic/mean_dilatation). These functions say where the
// nodes, rows and forces of patch p lie in their arrays, one patch beside the next. Needs PATCHES and TETRAHEDRA, the
// numbers of patches and of tetrahedra, and `patch_nodes`.

const uint PATCH_NODES = 12;
const uint PATCH_TETRAHEDRA = 12;

// Four of a patch's nodes; q is 0, 1 or 2.
uvec4 patch_quad(uint p, uint q) {
    return fetch(patch_nodes, PATCHES * q + p);
}

// Index of the row of a patch's k-th node.
uint patch_row(uint p, uint k) {
    return PATCHES * k + p;
}

// Index of the force on a patch's k-th node in `element_forces`, behind those of all tetrahedra and four zeros.
uint patch_entry(uint p, uint k) {
    return 4 * (TETRAHEDRA + 1) + patch_row(p, k);
}
