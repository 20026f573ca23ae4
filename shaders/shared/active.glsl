// Which active proxy an invocation works for: the last whose running total does not exceed the index. Needs `active_list`
// and a macro-free choice of total: three small functions with the same bisection.

uint active_by_vertex(uint count, uint index) {
    uint low = 0, high = count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        if (active_list[middle].vertex_first <= index) low = middle; else high = middle;
    }
    return low;
}

uint active_by_triangle(uint count, uint index) {
    uint low = 0, high = count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        if (active_list[middle].triangle_first <= index) low = middle; else high = middle;
    }
    return low;
}

uint active_by_embed(uint count, uint index) {
    uint low = 0, high = count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        if (active_list[middle].embed_first <= index) low = middle; else high = middle;
    }
    return low;
}
