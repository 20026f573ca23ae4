// Spatial hash of skin vertices for the depth stage: a hash table (`buckets`) of linked lists (`hash_entries`). A
// contact patch (`ContactPatch`) is a column of space where two bodies a and b may touch; each side of it (a or b) has
// its own square cells in the plane across the patch's normal. `patch_side` is 2 * patch + (0: side a, 1: side b). An
// including shader declares BUCKETS, the number of lists, a power of two.
//
// The first BUCKETS words of `buckets` are the heads of the lists. After them lies, for each patch and side, a grid of
// GRID x GRID cells. A cell holds the sort key (`depth_key` in shared/depth_grid.glsl) of the side's vertex that lies
// farthest into the other body in this cell; by this key triangles of the other side are culled.
//
// An element of `hash_entries` is a skin vertex in a work item, which is a chunk (group of skin vertices) in one
// contact patch. The element holds the vertex's coordinates along tangent, bitangent and normal, as bits of floats, and
// the index of the next element of its list, or NONE at the end.

uint bucket_of(ivec2 cell, uint patch_side) {
    uint key = uint(cell.x) * 73856093u ^ uint(cell.y) * 19349663u ^ patch_side * 83492791u;
    return (key ^ key >> 15) & (BUCKETS - 1);
}

// Key that identifies a cell among the cells of all patches, since a list may hold vertices of several cells. A patch
// has fewer than 2^16 cells along its tangent and along its bitangent.
uvec2 cell_key(ivec2 cell, uint patch_side) { return uvec2(patch_side, cell.x | cell.y << 16); }

// Cell of a point with coordinates `at` (m) along tangent and bitangent. `precise` puts the same point into the same
// cell in every shader; of a division, which need not be rounded correctly, it would not.
ivec2 cell_of(ContactPatch contact_patch, uint side, vec2 at) {
    precise vec2 scaled = (at - contact_patch.low) * contact_patch.cells_per_metre[side];
    return ivec2(floor(scaled));
}

// Coordinates of a point along a patch's tangent, bitangent and normal, m. With `precise`, and without dot(), in which
// the compiler chooses the order of the sum, the coordinates of a point have the same bits in every shader.
vec3 along(ContactPatch contact_patch, vec3 x) {
    mat3 axes = transpose(mat3(contact_patch.tangent, contact_patch.bitangent, contact_patch.normal));
    precise vec3 at = x.x * axes[0] + x.y * axes[1] + x.z * axes[2];
    return at;
}
