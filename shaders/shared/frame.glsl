// Reads rigid coordinate frames, six texels each. An including shader declares the array `frames` of uvec4.

const uint FRAME_TEXELS = 6;

Frame frame_at(uint index) {
    uint first = FRAME_TEXELS * index;
    vec4 a = uintBitsToFloat(fetch(frames, first + 1)), b = uintBitsToFloat(fetch(frames, first + 2)),
        c = uintBitsToFloat(fetch(frames, first + 3)), d = uintBitsToFloat(fetch(frames, first + 4));
    return Frame(uintBitsToFloat(fetch(frames, first)), a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), vec4(c.yzw, d.x), d.yzw,
        fetch(frames, first + 5).x, uint[3](0, 0, 0));
}
