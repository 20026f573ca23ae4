// What a patch does to a change of velocity, c (c . p). Needs shared/patch.glsl, `patch_rows` (texels, from elastic/dilate),
// `change` and `element_forces`. Oracle: oracle::elastic::Elements::patch_rows.

// A row sums to zero, so what the first node has follows from the others: a common velocity gives no force at all.
void apply_patch(uint p) {
    vec3 row[PATCH_NODES];
    vec3 p0 = texelFetch(change, int(patch_node(p, 0))).xyz;
    float along = 0.0;
    for (int k = 1; k < PATCH_NODES; k++) {
        row[k] = texelFetch(patch_rows, PATCH_NODES * int(p) + k).xyz;
        along += dot(row[k], texelFetch(change, int(patch_node(p, k))).xyz - p0);
    }
    vec3 first = vec3(0.0);
    for (int k = 1; k < PATCH_NODES; k++) {
        vec3 f = along * row[k];
        first -= f;
        element_forces[patch_entry(p, k)] = vec4(f, 0.0);
    }
    element_forces[patch_entry(p, 0)] = vec4(first, 0.0);
}
