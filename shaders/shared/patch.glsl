// Patches of tetrahedra: where their nodes and forces lie. Needs TETRAHEDRA and `patch_nodes`.

const int PATCH_NODES = 12;

uint patch_node(uint p, int k) {
    return texelFetch(patch_nodes, 3 * int(p) + k / 4)[k % 4];
}

// A patch's forces stand in `element_forces` after those of all tetrahedra and the four zeros behind them.
uint patch_entry(uint p, int k) {
    return 4 * (TETRAHEDRA + 1) + PATCH_NODES * p + k;
}
