// Squares of a plane as pixels, SQUARES of them a side of clip space.

// One of six corners of two triangles that together cover the centres of the squares from first to last, each once, and of
// no others: their borders are the squares', half a pixel from any centre, and a centre on the diagonal belongs to one.
vec4 corner_of_squares(ivec2 first, ivec2 last, uint corner) {
    bool right = corner == 1 || corner >= 4, upper = corner == 2 || corner == 3 || corner == 5;
    vec2 at = vec2(right ? last.x + 1 : first.x, upper ? last.y + 1 : first.y);
    return vec4(at * (2.0 / float(SQUARES)) - 1.0, 0.0, 1.0);
}

// Two triangles of no area.
vec4 no_squares() { return vec4(0.0, 0.0, 0.0, 1.0); }
