// Sums of forces at a node: of the forces of its elements, or the product with its row of the assembled operator
// (shared/rows.glsl), and of the forces of its contacts. An including shader includes shared/entries.glsl, and declares
// `node_elements` (texels of four indices into `element_forces`, padded with the index of a zero force),
// `element_forces`, `contact_forces`, `stiffness_blocks` and `change` (the vector p that is multiplied).

vec3 gather_elements(uint first, uint quads) {
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < quads; k++) {
        uvec4 entry = fetch(node_elements, first + k);
        sum += fetch(element_forces, entry.x).xyz + fetch(element_forces, entry.y).xyz
            + fetch(element_forces, entry.z).xyz + fetch(element_forces, entry.w).xyz;
    }
    return sum;
}

// Product of the elements' part of the operator at a node whose change of velocity is p: the sum over its row of
// K_ij (p_j - p). `first` and `count` are the row's first texel and number of blocks.
vec3 gather_row(vec3 p, uint first, uint count) {
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < count; k++) {
        vec4 column = fetch(stiffness_blocks, row_texel(first, k, 0));
        vec3 d = fetch(change, uint(column.w)).xyz - p;
        sum += column.xyz * d.x + fetch(stiffness_blocks, row_texel(first, k, 1)).xyz * d.y
            + fetch(stiffness_blocks, row_texel(first, k, 2)).xyz * d.z;
    }
    return sum;
}

vec3 gather_contacts(uint node) {
    vec3 sum = vec3(0.0);
    uvec2 run = entries_of(node);
    for (uint k = run.x; k < run.x + run.y; k++) {
        uvec2 entry = entry_at(k);
        sum += uintBitsToFloat(entry.y) * fetch(contact_forces, entry.x).xyz;
    }
    return sum;
}
