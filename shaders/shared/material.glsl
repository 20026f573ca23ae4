// Reads elastic materials, two texels each. An including shader declares the array `materials` of uvec4.

ElasticMaterial material_at(uint index) {
    uvec4 bits = fetch(materials, 2 * index);
    vec4 first = uintBitsToFloat(bits), more = uintBitsToFloat(fetch(materials, 2 * index + 1));
    return ElasticMaterial(first.x, first.y, bits.z, first.w, float[4](more.x, more.y, more.z, more.w));
}
