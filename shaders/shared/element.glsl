// Deformation of a tetrahedron. Needs shared/link.glsl, `displacement`, `node_rest`, `links`, and SPANS, whether a
// tetrahedron may have nodes in several frames.

// Displacement of a node in the tetrahedron's frame (that of its first node); `link` leads from there to the node's own
// frame, and is 0 where they are the same.
vec3 displacement_in(uint node, uint link) {
    vec3 d = fetch(displacement, node).xyz;
    return SPANS && link != 0 ? across(links[link], fetch(node_rest, node).xyz, d) : d;
}

// Displacement gradient G = sum d_i g_i^T, with F = I + G; `g1` to `g3`: rest gradients of its last three nodes, 1/m.
mat3 displacement_gradient(uvec4 nodes, uvec4 link, vec3 g1, vec3 g2, vec3 g3) {
    vec3 d0 = fetch(displacement, nodes.x).xyz;
    vec3 d1 = displacement_in(nodes.y, link.y) - d0;
    vec3 d2 = displacement_in(nodes.z, link.z) - d0;
    vec3 d3 = displacement_in(nodes.w, link.w) - d0;
    return outerProduct(d1, g1) + outerProduct(d2, g2) + outerProduct(d3, g3);
}
