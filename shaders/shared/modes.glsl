// Modes of a block: the motions that the coarse level knows of it. Free nodes move as R (c0 + c1 x + c2 y + c3 z) with
// (x, y, z) their rest place about the middle of the block over its size and R the rotation of their frame; what a core
// carries moves as its twist, (R c0, R c1). Twelve numbers a block, three texels: c0 c1.x, c1.yz c2.xy, c2.z c3.

struct Modes {
    vec3 c0, c1, c2, c3;
};

Modes no_modes() { return Modes(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)); }

// What a node of a block gives to the sums over its modes of a force v.
void add_modes(inout Modes modes, vec3 v, vec3 at) {
    modes.c0 += v;
    modes.c1 += v * at.x;
    modes.c2 += v * at.y;
    modes.c3 += v * at.z;
}

// Where the modes move a node, in the axes of c0 to c3.
vec3 moved_by(Modes modes, vec3 at) { return modes.c0 + modes.c1 * at.x + modes.c2 * at.y + modes.c3 * at.z; }

vec4[3] packed(Modes m) { return vec4[3](vec4(m.c0, m.c1.x), vec4(m.c1.yz, m.c2.xy), vec4(m.c2.z, m.c3)); }

Modes unpacked(vec4 a, vec4 b, vec4 c) { return Modes(a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw); }

Modes to_frame(Modes m, vec4 q) {
    return Modes(rotate_back(q, m.c0), rotate_back(q, m.c1), rotate_back(q, m.c2), rotate_back(q, m.c3));
}

Modes to_world(Modes m, vec4 q) { return Modes(rotate(q, m.c0), rotate(q, m.c1), rotate(q, m.c2), rotate(q, m.c3)); }
