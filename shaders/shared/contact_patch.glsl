// Reads contact patches, five texels each. An including shader declares the array `contact_patches` of vec4.

const uint CONTACT_PATCH_TEXELS = 5;

ContactPatch contact_patch_at(uint index) {
    uint first = CONTACT_PATCH_TEXELS * index;
    vec4 a = fetch(contact_patches, first), b = fetch(contact_patches, first + 1), c = fetch(contact_patches, first + 2),
        d = fetch(contact_patches, first + 3), e = fetch(contact_patches, first + 4);
    return ContactPatch(a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yz, vec2(c.w, d.x), float[2](d.y, d.z), d.w, e.x,
        float[3](0.0, 0.0, 0.0));
}
