// Patches of tetrahedra: where their nodes, rows and forces lie, one patch beside the next. Needs PATCHES, TETRAHEDRA and
// `patch_nodes`.

const uint PATCH_NODES = 12;
const uint PATCH_TETRAHEDRA = 12;

// Four of a patch's nodes, q in 0..2.
uvec4 patch_quad(uint p, uint q) {
    return fetch(patch_nodes, PATCHES * q + p);
}

uint patch_row(uint p, uint k) {
    return PATCHES * k + p;
}

// A patch's forces stand in `element_forces` after those of all tetrahedra and the four zeros behind them.
uint patch_entry(uint p, uint k) {
    return 4 * (TETRAHEDRA + 1) + patch_row(p, k);
}
