// A region's column in FIELD x FIELD squares: the greatest height that chunks of a reach in each, then the least height of
// chunks of b, as sortable integers. Needs `fields`.

const uint FIELD = 16;

uint height_key(float height) {
    uint bits = floatBitsToUint(height);
    return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}

uint field_at(uint region, uint side) { return (2 * region + side) * FIELD * FIELD; }

// First and last square along each tangent that a box meets.
uvec4 squares(Region region, vec2 low, vec2 high) {
    vec2 scale = float(FIELD) / max(region.high - region.low, vec2(1.0e-12));
    vec2 first = clamp((low - region.low) * scale, vec2(0.0), vec2(FIELD - 1));
    vec2 last = clamp((high - region.low) * scale, vec2(0.0), vec2(FIELD - 1));
    return uvec4(first, last);
}
