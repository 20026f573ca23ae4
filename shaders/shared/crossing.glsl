// A triangle of one side against the vertices of the other that are binned in the squares that it may cover: where a vertex's
// ray along the region's normal, away from its own body's inside, crosses the triangle, the crossing is put on the vertex's
// list. Needs shared/bins.glsl, `buckets`, `bins`, `bin_squares`, `bin_hits`, `hits`, `counts`, MOST_HITS.

// Above all bins. A list is walked while its next lies below, and must then have come to NONE: Mesa's llvmpipe leaves loops
// early (see README), and that nothing else is so large, no compiler can know.
const uint ALL_BINS = 0x80000000u;

// Vertices that are looked at in one go. Where lanes are a vector, each round costs all that stands in it, whichever lane
// needs it: crossings are recorded after a few rounds, not within them; after many, lanes with one would wait for long.
const uint TURNS = 8;

void record_crossing(uint bin, bool front, float depth, uint triangle, uint item) {
    uint hit = atomicAdd(counts.hits, 1);
    if (hit < MOST_HITS) {
        uint next = atomicExchange(bin_hits[bin], hit);
        hits[hit] = uvec4(triangle, next, floatBitsToUint(depth), item << 1 | (front ? 1 : 0));
    } else {
        atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    }
}

// `corners` along the region's axes; `side` and `item` are the triangle's. One loop goes from list to list and along each,
// so that no lane waits for another at a list's end. How many squares' lists it came to the end of.
uint cross_squares(ivec2 first, ivec2 last, uint region_side, vec3 corners[3], uint side, uint triangle, uint item) {
    ivec2 cell = ivec2(first.x - 1, first.y);
    uint left = uint(last.x - first.x + 1) * uint(last.y - first.y + 1), ended = 0, bin = NONE;
    while (bin < ALL_BINS || left > 0) {
        uint at, turns = 0;
        float sum, volume;
        bool crossed = false;
        do {
            if (bin >= ALL_BINS) {
                bool wraps = cell.x == last.x;
                cell = ivec2(wraps ? first.x : cell.x + 1, wraps ? cell.y + 1 : cell.y);
                left--;
                uint bucket = bucket_of(cell, region_side);
                bin = fetch(buckets, bucket / 4)[bucket % 4];
            }
            if (bin < ALL_BINS) {
                at = bin;
                uvec4 found = fetch(bins, bin);
                vec3 x = uintBitsToFloat(found.xyz);
                // `precise` keeps an edge's product exactly opposite in both its triangles: no ray slips between them.
                precise vec2 p = corners[0].xy - x.xy, q = corners[1].xy - x.xy, r = corners[2].xy - x.xy;
                precise vec3 b = vec3(q.x * r.y - q.y * r.x, r.x * p.y - r.y * p.x, p.x * q.y - p.y * q.x);
                precise float b_sum = b.x + b.y + b.z;
                precise float b_heights =
                    b.x * (corners[0].z - x.z) + b.y * (corners[1].z - x.z) + b.z * (corners[2].z - x.z);
                sum = b_sum;
                volume = b_heights;
                // A vertex of a looks back along the normal for b's skin, a vertex of b along it for a's.
                crossed = (all(greaterThanEqual(b, vec3(0.0))) && (side == 1 ? volume < 0.0 : volume > 0.0))
                    || (all(lessThanEqual(b, vec3(0.0))) && (side == 1 ? volume > 0.0 : volume < 0.0));
                bin = found.w;
            }
            if (bin == NONE) ended++;
            turns++;
        } while (!crossed && turns < TURNS && (bin < ALL_BINS || left > 0));
        precise float depth = (side == 1 ? -volume : volume) / sum;
        // A bucket may hold several squares, and the triangle may cover more than one of them.
        if (crossed && depth > 0.0 && bin_squares[at] == square_key(cell, region_side)) {
            record_crossing(at, side == 1 ? sum < 0.0 : sum > 0.0, depth, triangle, item);
        }
    }
    return ended;
}
