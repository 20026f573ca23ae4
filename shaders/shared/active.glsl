// Which active proxy an invocation works for: the last whose running total, of the things it counts, does not exceed the
// index. Needs `active_list`.

const uint OF_VERTICES = 0;
const uint OF_TRIANGLES = 1;
const uint OF_EMBEDS = 2;

uint first_of(uint entry, uint things) {
    if (things == OF_VERTICES) return active_list[entry].vertex_first;
    if (things == OF_TRIANGLES) return active_list[entry].triangle_first;
    return active_list[entry].embed_first;
}

uint active_with(uint things, uint index, uint count) {
    uint low = 0, high = count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        if (first_of(middle, things) <= index) low = middle; else high = middle;
    }
    return low;
}
