// Spatial hash of the skin vertices of one side (body a or b) of a contact patch (`ContactPatch`), over square cells of
// the patch's plane: a hash table (`buckets`) of linked lists (`hash_entries`). An including shader declares BUCKETS,
// the number of lists, a power of two.
//
// The first BUCKETS words of `buckets` are the heads of the lists. After them lies, for each patch and side, a depth
// grid of GRID x GRID cells (shared/depth_grid.glsl): in each cell the key of the vertex of that side that lies
// farthest into the other body, against which triangles of the other side are culled.
//
// An element of `hash_entries` is a skin vertex in a work item (active chunk and patch): its coordinates along tangent,
// bitangent and normal, as bits of floats, and the next element of its list, or NONE at the end. `patch_side` is 2 *
// patch + side. A work item is a chunk (group of skin vertices) in one contact patch, which is a column of space where
// two bodies may touch.

uint bucket_of(ivec2 cell, uint patch_side) {
    uint key = uint(cell.x) * 73856093u ^ uint(cell.y) * 19349663u ^ patch_side * 83492791u;
    return (key ^ key >> 15) & (BUCKETS - 1);
}

// Identifies a cell among those of all patches; a list may mix several cells. A patch has less than 2^16 cells a side.
uvec2 cell_key(ivec2 cell, uint patch_side) { return uvec2(patch_side, cell.x | cell.y << 16); }

// Cell of a point in the patch's plane. `precise` puts the same point into the same cell in every shader.
ivec2 cell_of(ContactPatch contact_patch, uint side, vec2 at) {
    precise vec2 scaled = (at - contact_patch.low) / contact_patch.cell[side];
    return ivec2(floor(scaled));
}

// Coordinates of a point along tangent, bitangent and normal. With `precise`, and without dot(), in which the compiler
// chooses the order of the sum, the same point has the same bits in every shader.
vec3 along(ContactPatch contact_patch, vec3 x) {
    mat3 axes = transpose(mat3(contact_patch.tangent, contact_patch.bitangent, contact_patch.normal));
    precise vec3 at = x.x * axes[0] + x.y * axes[1] + x.z * axes[2];
    return at;
}
