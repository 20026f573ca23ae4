// Vertices of a region's side in squares of its plane: a hash table of linked lists. Needs BUCKETS, a power of two.
// After the heads lie the sights: in each square of a region's field (see shared/field.glsl) how far back the vertices in
// lists look, by side.

// A vertex as an item sees it: u, v, h along the region's axes; the next of its bucket (NONE: the last), bit for bit.

uint bucket_of(ivec2 cell, uint region_side) {
    uint key = uint(cell.x) * 73856093u ^ uint(cell.y) * 19349663u ^ region_side * 83492791u;
    return (key ^ key >> 15) & (BUCKETS - 1);
}

// No other square has the same; a column has less than 2^16 of them a side.
uvec2 square_key(ivec2 cell, uint region_side) { return uvec2(region_side, cell.x | cell.y << 16); }

// `precise`: the same point is in the same square wherever it is asked for.
ivec2 cell_of(Region region, uint side, vec2 at) {
    precise vec2 scaled = (at - region.low) / region.cell[side];
    return ivec2(floor(scaled));
}

// `precise`, and no dot(), whose order is the compiler's: the same point projects to the same bits in every shader.
vec3 along(Region region, vec3 x) {
    mat3 axes = transpose(mat3(region.tangent, region.bitangent, region.normal));
    precise vec3 at = x.x * axes[0] + x.y * axes[1] + x.z * axes[2];
    return at;
}
