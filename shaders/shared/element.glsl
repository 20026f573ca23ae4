// Deformation of a tetrahedron. An including shader includes shared/link.glsl and declares `displacement`, `node_rest`,
// `links`, and SPANS: whether a tetrahedron may have nodes in several frames (rigid coordinate frames).

// Displacement of a node in the tetrahedron's frame, which is that of its first node. `link` is the index of the
// relative placement of that frame and the node's own, or 0 where both are the same.
vec3 displacement_in(uint node, uint link) {
    vec3 d = fetch(displacement, node).xyz;
    return SPANS && link != 0 ? across(link_at(link), fetch(node_rest, node).xyz, d) : d;
}

// Displacement gradient G = sum d_i g_i^T, over displacements d_i and rest gradients g_i of the four nodes, so that the
// deformation gradient is F = I + G. `g1` to `g3` are the rest gradients of the last three nodes, 1/m.
mat3 displacement_gradient(uvec4 nodes, uvec4 link, vec3 g1, vec3 g2, vec3 g3) {
    vec3 d0 = fetch(displacement, nodes.x).xyz;
    vec3 d1 = displacement_in(nodes.y, link.y) - d0;
    vec3 d2 = displacement_in(nodes.z, link.z) - d0;
    vec3 d3 = displacement_in(nodes.w, link.w) - d0;
    return outerProduct(d1, g1) + outerProduct(d2, g2) + outerProduct(d3, g3);
}
