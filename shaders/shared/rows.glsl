// The assembled operator: for each node a row of 3x3 blocks, one for each other node with which it shares a tetrahedron.
// Rows are stored in slices (SELL-C-sigma format, Kreutzer and others 2014) of ROW_SLICE nodes that are neighbours in
// the list of a block of nodes, so that lanes that each work on a row read neighbouring texels: the k-th blocks of the
// rows of a slice lie together, column by column. A column of a block is the xyz of a texel; the w of the first column
// is the index of the other node, as a float, which is exact below ROW_NODES. A row's first texel and number of blocks
// are in a copy of the array `block_nodes`.

const uint ROW_SLICE = 8;               // nodes in a slice
const uint ROW_NODES = 16777216;        // number of nodes up to which the operator can be assembled

// Texel of column c of block k of a row.
uint row_texel(uint first, uint k, uint c) { return first + (3 * k + c) * ROW_SLICE; }
