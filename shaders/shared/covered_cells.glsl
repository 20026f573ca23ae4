// A triangle of one side (0: body a, 1: body b) of a contact patch (`ContactPatch`: a column of space where two bodies
// may touch) in the patch's axes, and the cells that the triangle's box covers in the spatial hash of the other side's
// vertices. An including shader includes shared/spatial_hash.glsl and shared/depth_grid.glsl, and declares `triangles`,
// `skin` and `buckets` as read-only arrays.

// Whether the ray of some vertex of the other side may meet a triangle of `side`. The triangle's box runs from `least`
// to `greatest`; `height` is the coordinate along the normal up to which the triangle reaches towards the other body,
// m. The answer is true if, in any cell of the grid of sort keys (shared/spatial_hash.glsl) that the box covers, this
// height reaches the other side's vertex that lies farthest into the triangle's body. The answer is also true where the
// driver ends the loops before all cells are tested.
bool seen(ContactPatch contact_patch, uint patch_index, uint side, vec2 least, vec2 greatest, float height) {
    // The margin covers the rounding of the exact test in shared/ray_hit.glsl.
    vec2 margin = 1.0e-3 * grid_cell_size(contact_patch);
    uvec4 range = grid_cells(contact_patch, least - margin, greatest + margin);
    uint left = (range.z - range.x + 1) * (range.w - range.y + 1);
    uint grid = BUCKETS + grid_first(patch_index, 1 - side), key = depth_key(side, height);
    for (uint y = range.y; y <= range.w; y++) {
        for (uint x = range.x; x <= range.z; x++) {
            left--;
            uint at = grid + y * GRID + x;
            if (key >= fetch(buckets, at / 4)[at % 4]) return true;
        }
    }
    return left != 0;
}

// Corners of a triangle along the patch's axes, and its box in the patch's plane, clipped to the patch.
void box_of(ContactPatch contact_patch, uint triangle, out vec3 corners[3], out vec2 least, out vec2 greatest) {
    uvec3 vertices = fetch(triangles, triangle).xyz;
    corners = vec3[](along(contact_patch, fetch(skin, vertices.x).xyz),
        along(contact_patch, fetch(skin, vertices.y).xyz), along(contact_patch, fetch(skin, vertices.z).xyz));
    least = max(min(min(corners[0].xy, corners[1].xy), corners[2].xy), contact_patch.low);
    greatest = min(max(max(corners[0].xy, corners[1].xy), corners[2].xy), contact_patch.high);
}

// First and last hash cell that the box of a triangle of `side` covers; the box must not be empty.
void box_cells(ContactPatch contact_patch, uint side, uint triangle, out vec3 corners[3], out ivec2 first, out ivec2 last) {
    vec2 least, greatest;
    box_of(contact_patch, triangle, corners, least, greatest);
    first = cell_of(contact_patch, 1 - side, least);
    last = cell_of(contact_patch, 1 - side, greatest);
}

// Corners of a triangle, and the first and last hash cell that its box covers; returns false if no vertex in these
// cells can have a ray that meets the triangle.
bool covered_cells(
    ContactPatch contact_patch, uint patch_index, uint side, uint triangle, out vec3 corners[3], out ivec2 first,
    out ivec2 last) {
    vec2 least, greatest;
    box_of(contact_patch, triangle, corners, least, greatest);
    first = cell_of(contact_patch, 1 - side, least);
    last = cell_of(contact_patch, 1 - side, greatest);
    // Coordinates that are not finite have no cells.
    vec3 sum = corners[0] + corners[1] + corners[2];
    if (any(greaterThan(least, greatest)) || !is_finite(sum.x + sum.y + sum.z)) return false;
    float height = side == 0 ? max(max(corners[0].z, corners[1].z), corners[2].z)
                             : min(min(corners[0].z, corners[1].z), corners[2].z);
    return seen(contact_patch, patch_index, side, least, greatest, height);
}
