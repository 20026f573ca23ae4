// A region's column in FIELD x FIELD squares: the greatest height that chunks of a reach in each, then the least height of
// chunks of b, as sortable integers, four a texel. Needs `fields` where it is written.

const uint FIELD = 16;

uint height_key(float height) {
    uint bits = floatBitsToUint(height);
    return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}

// How far back a triangle of this side reaches, or a vertex of the other side looks: the triangle may be seen where its key
// is no less.
uint reach_key(uint side, float height) { return side == 0 ? height_key(height) : ~height_key(height); }

uint field_at(uint region, uint side) { return (2 * region + side) * FIELD * FIELD; }

vec2 square_size(Region region) { return max(region.high - region.low, vec2(1.0e-12)) / float(FIELD); }

// First and last square along each tangent that a box meets.
uvec4 squares(Region region, vec2 low, vec2 high) {
    vec2 size = square_size(region);
    vec2 first = clamp((low - region.low) / size, vec2(0.0), vec2(FIELD - 1));
    vec2 last = clamp((high - region.low) / size, vec2(0.0), vec2(FIELD - 1));
    return uvec4(first, last);
}

// How far a chunk may reach towards the other side: its box along the tangents, and a plane that it does not pass.
struct Slab {
    vec2 low, high;
    vec3 plane;                 // height = plane.x u + plane.y v + plane.z
    float extreme;              // of the box
};

// The greatest height in a square of a chunk of a; the least of one of b.
float slab_height(Region region, Slab slab, uint side, uvec2 square) {
    vec2 size = square_size(region);
    vec2 low = max(region.low + vec2(square) * size, slab.low), high = min(region.low + vec2(square + 1) * size, slab.high);
    // Squares lie a rounding further apart than they should.
    low -= 1.0e-3 * size;
    high += 1.0e-3 * size;
    bvec2 rises = greaterThan(slab.plane.xy, vec2(0.0));
    vec2 corner = side == 0 ? mix(low, high, rises) : mix(high, low, rises);
    float height = dot(slab.plane.xy, corner) + slab.plane.z;
    return side == 0 ? min(height, slab.extreme) : max(height, slab.extreme);
}
