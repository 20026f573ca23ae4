// What a node moves by in the frame of the proxy or chunk that lists it. Needs shared/link.glsl, SPANS, `displacement`,
// `node_rest` and `links`.

// The node, and its link from that frame.
vec3 moved(uvec2 node) {
    vec3 d = fetch(displacement, node.x).xyz;
    if (SPANS && node.y != 0) d = across(links[node.y], fetch(node_rest, node.x).xyz, d);
    return d;
}
