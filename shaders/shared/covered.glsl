// A triangle in a region's axes, and which squares of the other side it may cover. Needs shared/bins.glsl, shared/field.glsl,
// `triangles`, `skin` and `buckets` as texels.

// Whether a vertex of the other side looks as far back as the triangle reaches, in some square of the field that it covers;
// so too where the driver leaves the loops before all are looked at.
bool seen(Region region, uint region_index, uint side, vec2 least, vec2 greatest, float height) {
    // A rounding more, as the exact test has one.
    vec2 margin = 1.0e-3 * square_size(region);
    uvec4 range = squares(region, least - margin, greatest + margin);
    uint left = (range.z - range.x + 1) * (range.w - range.y + 1);
    uint field = BUCKETS + field_at(region_index, 1 - side), key = reach_key(side, height);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            left--;
            uint at = field + y * FIELD + x;
            if (key >= fetch(buckets, at / 4)[at % 4]) return true;
        }
    }
    return left != 0;
}

// A triangle's corners, and its box where vertices are looked for.
void box_of(Region region, uint triangle, out vec3 corners[3], out vec2 least, out vec2 greatest) {
    uvec3 vertices = fetch(triangles, triangle).xyz;
    corners = vec3[](along(region, fetch(skin, vertices.x).xyz),
        along(region, fetch(skin, vertices.y).xyz), along(region, fetch(skin, vertices.z).xyz));
    least = max(min(min(corners[0].xy, corners[1].xy), corners[2].xy), region.low);
    greatest = min(max(max(corners[0].xy, corners[1].xy), corners[2].xy), region.high);
}

// The squares that the box meets, where it is not empty; `side` is the triangle's.
void box_squares(Region region, uint side, uint triangle, out vec3 corners[3], out ivec2 first, out ivec2 last) {
    vec2 least, greatest;
    box_of(region, triangle, corners, least, greatest);
    first = cell_of(region, 1 - side, least);
    last = cell_of(region, 1 - side, greatest);
}

// Whether any may hold a vertex that the triangle's ray crosses.
bool covered_squares(
    Region region, uint region_index, uint side, uint triangle, out vec3 corners[3], out ivec2 first, out ivec2 last) {
    vec2 least, greatest;
    box_of(region, triangle, corners, least, greatest);
    first = cell_of(region, 1 - side, least);
    last = cell_of(region, 1 - side, greatest);
    if (any(greaterThan(least, greatest))) return false;
    float height = side == 0 ? max(max(corners[0].z, corners[1].z), corners[2].z)
                             : min(min(corners[0].z, corners[1].z), corners[2].z);
    return seen(region, region_index, side, least, greatest, height);
}
