// Sums of forces at a node: of the forces of its elements, and of the forces of its contacts. An including shader
// declares `node_elements` (texels of four indices into `element_forces`, padded with the index of a zero force),
// `element_forces`, `sorted` (contact and weight of each entry), `node_entries` (first entry of a node in `sorted`, and
// number of its entries) and `contact_forces`.

// Product of an edge's block with a difference d of changes of velocity. `edge` is twice the index of the edge, plus 1
// for the transpose of the block.
vec3 edge_force(uint edge, vec3 d) {
    uint at = 3 * (edge / 2);
    mat3 block = mat3(fetch(stiffness_blocks, at).xyz, fetch(stiffness_blocks, at + 1).xyz, fetch(stiffness_blocks, at + 2).xyz);
    return (edge & 1) == 0 ? block * d : d * block;
}

vec3 gather_elements(uint first, uint quads) {
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < quads; k++) {
        uvec4 entry = fetch(node_elements, first + k);
        sum += fetch(element_forces, entry.x).xyz + fetch(element_forces, entry.y).xyz
            + fetch(element_forces, entry.z).xyz + fetch(element_forces, entry.w).xyz;
    }
    return sum;
}

// Product of the elements' part of the operator at a node whose change of velocity is p: sum K_ij (p_j - p) over its
// edges. `first` and `texels`: its texels in `node_edges`.
vec3 gather_edges(vec3 p, uint first, uint texels) {
    vec3 sum = vec3(0.0);
    for (uint k = first; k < first + texels; k++) {
        uvec4 two = fetch(node_edges, k);
        sum += edge_force(two.y, fetch(change, two.x).xyz - p) + edge_force(two.w, fetch(change, two.z).xyz - p);
    }
    return sum;
}

vec3 gather_contacts(uint node) {
    vec3 sum = vec3(0.0);
    uvec2 run = node_entries[node];
    for (uint k = run.x; k < run.x + run.y; k++) {
        uvec2 entry = sorted[k];
        sum += uintBitsToFloat(entry.y) * fetch(contact_forces, entry.x).xyz;
    }
    return sum;
}
