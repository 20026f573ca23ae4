// Reads the lists of contacts by node; an entry is a contact and its weight at the node. An including shader declares the
// arrays `node_entries` and `sorted` of uvec4, each texel of which holds two of the pairs below.

// First entry of a node in `sorted`, and number of its entries.
uvec2 entries_of(uint node) { return half_of(fetch(node_entries, node / 2), node); }

// Contact of entry k, and bits of its weight.
uvec2 entry_at(uint k) { return half_of(fetch(sorted, k / 2), k); }
