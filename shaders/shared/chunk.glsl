// Reads chunks, five texels each. An including shader declares the array `chunks` of uvec4.

const uint CHUNK_TEXELS = 5;

Chunk chunk_at(uint index) {
    uint first = CHUNK_TEXELS * index;
    vec4 a = uintBitsToFloat(fetch(chunks, first)), b = uintBitsToFloat(fetch(chunks, first + 1)),
        c = uintBitsToFloat(fetch(chunks, first + 2));
    uvec4 d = fetch(chunks, first + 3), e = fetch(chunks, first + 4);
    return Chunk(a.xyz, vec3[2](vec3(a.w, b.xy), vec3(b.zw, c.x)), c.yzw, uintBitsToFloat(d.x), d.y, d.z, d.w, e.x, e.y,
        e.z, e.w);
}
