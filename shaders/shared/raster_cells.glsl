// Cells of a spatial hash of skin vertices as pixels, for the graphics version of the depth stage, which finds
// penetration depths: RASTER_CELLS cells span a side of clip space.

// Place in clip space of a corner (`corner`, 0 to 5) of two triangles that together cover the centres of the cells from
// `first` to `last`, each centre once, and no other centre: the triangles' borders run along cell borders, half a pixel
// from any centre, and a centre on the diagonal belongs to one of the two triangles.
vec4 corner_of_cells(ivec2 first, ivec2 last, uint corner) {
    bool right = corner == 1 || corner >= 4, upper = corner == 2 || corner == 3 || corner == 5;
    vec2 at = vec2(right ? last.x + 1 : first.x, upper ? last.y + 1 : first.y);
    return vec4(at * (2.0 / float(RASTER_CELLS)) - 1.0, 0.0, 1.0);
}

// Place in clip space of each corner of triangles that are to cover nothing: they have no area.
vec4 no_cells() { return vec4(0.0, 0.0, 0.0, 1.0); }
