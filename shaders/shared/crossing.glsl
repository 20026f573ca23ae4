// A triangle of one side against the vertices of the other that are binned in one square: where a vertex's ray along the
// region's normal, away from its own body's inside, crosses the triangle, the crossing is put on the vertex's list. Needs
// shared/bins.glsl, `buckets`, `bins`, `bin_squares`, `bin_hits`, `hits`, `counts`, MOST_HITS.

// Above all bins. A list is walked while its next lies below, and must then have come to NONE: Mesa's llvmpipe leaves loops
// early (see README), and that nothing else is so large, no compiler can know.
const uint ALL_BINS = 0x80000000u;

// `corners` along the region's axes; `side` and `item` are the triangle's.
void cross_square(ivec2 cell, uint region_side, vec3 corners[3], uint side, uint triangle, uint item) {
    uint bucket = bucket_of(cell, region_side);
    uvec2 square = square_key(cell, region_side);
    uint bin = texelFetch(buckets, int(bucket / 4))[bucket % 4];
    while (bin < ALL_BINS) {
        uvec4 found = texelFetch(bins, int(bin));
        vec3 x = uintBitsToFloat(found.xyz);
        // `precise` keeps an edge's product exactly opposite in both its triangles: no ray slips between them.
        precise vec2 p = corners[0].xy - x.xy, q = corners[1].xy - x.xy, r = corners[2].xy - x.xy;
        precise vec3 b = vec3(q.x * r.y - q.y * r.x, r.x * p.y - r.y * p.x, p.x * q.y - p.y * q.x);
        if (all(greaterThanEqual(b, vec3(0.0))) || all(lessThanEqual(b, vec3(0.0)))) {
            precise float sum = b.x + b.y + b.z;
            precise float height = (b.x * (corners[0].z - x.z) + b.y * (corners[1].z - x.z) + b.z * (corners[2].z - x.z)) / sum;
            // A vertex of a looks back along the normal for b's skin, a vertex of b along it for a's.
            float depth = side == 1 ? -height : height;
            // A bucket may hold several squares, and the triangle may cover more than one of them.
            if (sum != 0.0 && depth > 0.0 && bin_squares[bin] == square) {
                bool front = side == 1 ? sum < 0.0 : sum > 0.0;
                uint hit = atomicAdd(counts.hits, 1);
                if (hit < MOST_HITS) {
                    uint next = atomicExchange(bin_hits[bin], hit);
                    hits[hit] = uvec4(triangle, next, floatBitsToUint(depth), item << 1 | (front ? 1 : 0));
                } else {
                    atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
                }
            }
        }
        bin = found.w;
    }
    if (bin != NONE) atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
}
