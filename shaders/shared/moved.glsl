// Displacements of nodes in the frame of the proxy or chunk that lists them. Needs shared/link.glsl, SPANS (whether
// these may have nodes in other frames), `displacement`, `node_rest` and `links`.

// Displacement of a listed node; `node` is its index, and the link from the proxy's or chunk's frame to its own.
vec3 moved(uvec2 node) {
    vec3 d = fetch(displacement, node.x).xyz;
    if (SPANS && node.y != 0) d = across(links[node.y], fetch(node_rest, node.x).xyz, d);
    return d;
}
