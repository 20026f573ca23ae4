// A region's tile: coordinates along its tangents in texels, and heights along its normal as sortable integers. Side a is
// seen from b (its greatest height wins), side b from a (its least height wins); both become "least key wins".

vec3 to_tile(Region region, vec3 x) {
    // `precise`: two pipelines compare what comes of it bit for bit.
    precise vec3 at = vec3(dot(x, region.tangent), dot(x, region.bitangent), dot(x, region.normal));
    precise vec2 uv = (at.xy - region.low) / region.texel;
    return vec3(uv, at.z);
}

uint height_key(float height, bool side_b) {
    uint bits = floatBitsToUint(side_b ? height : -height);
    return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}

// Twice the signed area of the triangle p, q, x in the tile.
float edge(vec2 p, vec2 q, vec2 x) {
    precise float area = (q.x - p.x) * (x.y - p.y) - (q.y - p.y) * (x.x - p.x);
    return area;
}
