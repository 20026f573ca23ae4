// Min-max depth grids of a contact patch (`ContactPatch`: a column of space where two bodies a and b may touch, with a
// normal from a to b), each of GRID x GRID cells over the patch's rectangle. In each cell the first grid holds the
// greatest height (coordinate along the normal) that the skin (surface mesh) of body a reaches, the second the least
// height that the skin of body b reaches. Skin enters by chunks (groups of at most 64 vertices). Heights are kept as
// integers that sort like the floats. A side is body a (0) or b (1). A shader that writes the grids declares
// `depth_grids`.

const uint GRID = 16;  // number of rows, and of columns, of a depth grid

// An unsigned integer that sorts like the float.
uint height_key(float height) {
    uint bits = floatBitsToUint(height);
    return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}

float height_of_key(uint key) { return uintBitsToFloat((key & 0x80000000u) != 0 ? key & 0x7fffffffu : ~key); }

// Sort key of a height, which grows in the direction in which `side` reaches towards the other body. The ray of a
// vertex of the other side may meet a triangle of `side` only where the triangle's key is at least the vertex's key.
uint depth_key(uint side, float height) { return side == 0 ? height_key(height) : ~height_key(height); }

// Index of the first cell of a side's grid.
uint grid_first(uint contact_patch, uint side) { return (2 * contact_patch + side) * GRID * GRID; }

vec2 grid_cell_size(ContactPatch contact_patch) {
    return max(contact_patch.high - contact_patch.low, vec2(1.0e-12)) / float(GRID);
}

// First cell (x, y) and last cell (z, w) that a box in the patch's plane covers.
uvec4 grid_cells(ContactPatch contact_patch, vec2 low, vec2 high) {
    vec2 size = grid_cell_size(contact_patch);
    vec2 first = clamp((low - contact_patch.low) / size, vec2(0.0), vec2(GRID - 1));
    vec2 last = clamp((high - contact_patch.low) / size, vec2(0.0), vec2(GRID - 1));
    return uvec4(first, last);
}

// Bound on a chunk in a patch's axes: its box along the tangents, and a plane that bounds it towards the other body.
struct Slab {
    vec2 low, high;             // the box along the tangents, m
    vec3 plane;                 // height of the plane at tangential coordinates u, v: plane.x u + plane.y v + plane.z
    float extreme;              // greatest height of the box for a chunk of a, least for one of b, m
};

// Bound on the height of a chunk within a cell: an upper bound for a chunk of a, a lower bound for one of b.
float slab_height(ContactPatch contact_patch, Slab slab, uint side, uvec2 grid_cell) {
    vec2 size = grid_cell_size(contact_patch);
    vec2 low = max(contact_patch.low + vec2(grid_cell) * size, slab.low);
    vec2 high = min(contact_patch.low + vec2(grid_cell + 1) * size, slab.high);
    // The margin covers the rounding of the cells' borders.
    low -= 1.0e-3 * size;
    high += 1.0e-3 * size;
    bvec2 rises = greaterThan(slab.plane.xy, vec2(0.0));
    vec2 corner = side == 0 ? mix(low, high, rises) : mix(high, low, rises);
    float height = dot(slab.plane.xy, corner) + slab.plane.z;
    return side == 0 ? min(height, slab.extreme) : max(height, slab.extreme);
}
