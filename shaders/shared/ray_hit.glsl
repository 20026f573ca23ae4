// Part of the depth stage: exact test of a triangle of one side (body a or b) of a contact patch (column of space where
// a and b may touch) against the rays of the other side's vertices, in those cells of the patch's spatial hash that the
// triangle covers. The ray of a vertex of a runs against the patch's normal (which points from a to b), the ray of a
// vertex of b along the normal. A hit goes onto the vertex's linked list, whose head is in `entry_hits`. A work item is
// a chunk (group of skin vertices) in one contact patch. An including shader includes shared/spatial_hash.glsl and
// declares `buckets`, `hash_entries`, `entry_cells` (two in a texel), `entry_hits`, `hits`, `counts` and MOST_HITS (room for
// hits).

// A number above every index of `hash_entries` and below NONE. A loop follows a list while the next index is below this
// number. If that index is not NONE after the loop, Mesa's software renderer llvmpipe ended the loop early (see
// docs/evidence/benchmarks.md). Were NONE the loop's own bound, the compiler would remove the test after the loop.
const uint ALL_ENTRIES = 0x80000000u;

// Greatest number of rounds of the inner loop, one vertex each, before hits are recorded. On GPUs and vector CPUs each
// round of a loop costs all the code in it, whichever lane needs it, so recording stays outside the inner loop. More
// rounds would let lanes that have a hit wait longer for the others.
const uint TURNS = 8;

// Puts a hit at the head of a vertex's list: index of the triangle, index of the list's next hit, depth (m), the
// triangle's work item, and whether the triangle is a front face, one through which the ray leaves the triangle's body.
void record_ray_hit(uint hash_entry, bool front, float depth, uint triangle, uint work_item) {
    uint hit = atomicAdd(counts.hits, 1);
    if (hit < MOST_HITS) {
        uint next = atomicExchange(entry_hits[hash_entry], hit);
        hits[hit] = uvec4(triangle, next, floatBitsToUint(depth), work_item << 1 | (front ? 1 : 0));
    } else {
        atomicOr(counts.flags, FLAG_CONTACT_OVERFLOW);
    }
}

// Tests a triangle against all vertices of the other side in the cells from `first` to `last`. `corners` are the
// coordinates of the triangle's corners along the patch's axes, m; `side` and `work_item` belong to the triangle,
// `patch_side` (2 * patch + the other side) to the vertices. One loop goes through the cells' lists and along each
// list, so that no lane waits for others at the end of a list. Returns the number of lists whose end was reached.
uint hit_cells(ivec2 first, ivec2 last, uint patch_side, vec3 corners[3], uint side, uint triangle, uint work_item) {
    ivec2 cell = ivec2(first.x - 1, first.y);
    uint left = uint(last.x - first.x + 1) * uint(last.y - first.y + 1), ended = 0, hash_entry = NONE;
    for (uint k = 0; k < MOST_ROUNDS && (hash_entry < ALL_ENTRIES || left > 0); k++) {
        uint at, turns = 0;
        float sum, volume;
        bool is_hit = false;
        do {
            if (hash_entry >= ALL_ENTRIES) {
                bool wraps = cell.x == last.x;
                cell = ivec2(wraps ? first.x : cell.x + 1, wraps ? cell.y + 1 : cell.y);
                left--;
                uint bucket = bucket_of(cell, patch_side);
                hash_entry = fetch(buckets, bucket / 4)[bucket % 4];
            }
            if (hash_entry < ALL_ENTRIES) {
                at = hash_entry;
                uvec4 found = fetch(hash_entries, hash_entry);
                vec3 x = uintBitsToFloat(found.xyz);
                // `precise` gives an edge's product exactly opposite signs in the two triangles that share the edge, so
                // that no ray passes between these triangles.
                precise vec2 p = corners[0].xy - x.xy, q = corners[1].xy - x.xy, r = corners[2].xy - x.xy;
                precise vec3 b = vec3(q.x * r.y - q.y * r.x, r.x * p.y - r.y * p.x, p.x * q.y - p.y * q.x);
                precise float b_sum = b.x + b.y + b.z;
                precise float b_heights =
                    b.x * (corners[0].z - x.z) + b.y * (corners[1].z - x.z) + b.z * (corners[2].z - x.z);
                sum = b_sum;
                volume = b_heights;
                // A hit lies on the vertex's ray: from a vertex of a against the normal, from a vertex of b along it.
                is_hit = (all(greaterThanEqual(b, vec3(0.0))) && (side == 1 ? volume < 0.0 : volume > 0.0))
                    || (all(lessThanEqual(b, vec3(0.0))) && (side == 1 ? volume > 0.0 : volume < 0.0));
                hash_entry = found.w;
            }
            if (hash_entry == NONE) ended++;
            turns++;
        } while (!is_hit && turns < TURNS && (hash_entry < ALL_ENTRIES || left > 0));
        precise float depth = (side == 1 ? -volume : volume) / sum;
        // A list may hold vertices of several cells. So that a vertex counts once, a hit is recorded only when the loop
        // visits the vertex's own cell.
        uvec4 cells = is_hit ? fetch(entry_cells, at / 2) : uvec4(0);
        if (is_hit && depth > 0.0 && half_of(cells, at) == cell_key(cell, patch_side)) {
            record_ray_hit(at, side == 1 ? sum < 0.0 : sum > 0.0, depth, triangle, work_item);
        }
    }
    return ended;
}
