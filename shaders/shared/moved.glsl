// Displacements of the nodes of a soft body's tetrahedral mesh, converted to the frame (rigid coordinate frame) of a
// collision proxy or chunk (group of skin vertices) that lists these nodes. A link is the relative placement of two
// frames. An including shader includes shared/link.glsl and declares `displacement`, `node_rest`, `links`, and SPANS:
// whether a listed node may be in another frame than the proxy or chunk.

// Displacement of a listed node, m, in the frame of the proxy or chunk. `node.x` is the index of the node; `node.y` is
// the index of the link from that frame to the node's own, 0 where they are one frame.
vec3 moved(uvec2 node) {
    vec3 d = fetch(displacement, node.x).xyz;
    if (SPANS && node.y != 0) d = across(link_at(node.y), fetch(node_rest, node.x).xyz, d);
    return d;
}
