// Displacements of nodes in the frame (rigid coordinate frame) of the collision proxy or chunk (group of skin vertices)
// that lists them. An including shader includes shared/link.glsl and declares `displacement`, `node_rest`, `links`, and
// SPANS: whether a listed node may be in another frame. A link is the relative placement of two frames.

// Displacement of a listed node. `node` is its index, and the link from the frame of the proxy or chunk to the node's
// own.
vec3 moved(uvec2 node) {
    vec3 d = fetch(displacement, node.x).xyz;
    if (SPANS && node.y != 0) d = across(links[node.y], fetch(node_rest, node.x).xyz, d);
    return d;
}
