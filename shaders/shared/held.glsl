// The dynamic cores (rigid bodies whose motion the solver finds) that haptic devices hold as tools, through virtual
// couplings. An including shader declares `params` and HELD, the number of these cores.

// Index of a core among the held ones, or NONE.
uint held_index(uint core) {
    for (uint k = 0; k < HELD; k++) {
        if (params.held[k].core == core) return k;
    }
    return NONE;
}
