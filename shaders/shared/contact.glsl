// Reads and writes contacts, six texels each. An including shader declares the array `contacts` of uvec4.

const uint CONTACT_TEXELS = 6;

Contact contact_at(uint c) {
    uint first = CONTACT_TEXELS * c;
    uvec4 a = fetch(contacts, first), b = fetch(contacts, first + 1), p = fetch(contacts, first + 2),
        f = fetch(contacts, first + 3), v = fetch(contacts, first + 4), t = fetch(contacts, first + 5);
    return Contact(uintBitsToFloat(a.xyz), uintBitsToFloat(a.w), uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
        uintBitsToFloat(p.x), uintBitsToFloat(p.y), uintBitsToFloat(p.z), uintBitsToFloat(p.w), uintBitsToFloat(f.x),
        uintBitsToFloat(f.yzw), v.x, v.y, v.z, v.w, uintBitsToFloat(t.xy), vec2(0.0));
}

// Writes the two texels of a contact that hold what changes after contact/response: depth, rate, stiffness, damping,
// friction and slip.
#define store_contact(c, contact) { \
    store(contacts, CONTACT_TEXELS * (c) + 2, \
        floatBitsToUint(vec4((contact).depth, (contact).rate, (contact).stiffness, (contact).damping))); \
    store(contacts, CONTACT_TEXELS * (c) + 3, floatBitsToUint(vec4((contact).friction, (contact).slip))); \
}
