// Sums of forces at a node: of the forces of its elements, and of the forces of its contacts. An including shader
// declares `node_elements` (texels of four indices into `element_forces`, padded with the index of a zero force),
// `element_forces`, `sorted` (contact and weight of each entry), `node_entries` (first entry of a node in `sorted`, and
// number of its entries) and `contact_forces`.

vec3 gather_elements(uint first, uint quads) {
    vec3 sum = vec3(0.0);
    for (uint k = 0; k < quads; k++) {
        uvec4 entry = fetch(node_elements, first + k);
        sum += fetch(element_forces, entry.x).xyz + fetch(element_forces, entry.y).xyz
            + fetch(element_forces, entry.z).xyz + fetch(element_forces, entry.w).xyz;
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
