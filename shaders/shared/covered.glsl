// A triangle in a region's axes, and which squares of the other side it may cover. Needs shared/bins.glsl, `triangles`, `skin`.

// Whether any; `side` is the triangle's.
bool covered_squares(Region region, uint side, uint triangle, out vec3 corners[3], out ivec2 first, out ivec2 last) {
    uvec3 vertices = texelFetch(triangles, int(triangle)).xyz;
    corners = vec3[](along(region, texelFetch(skin, int(vertices.x)).xyz),
        along(region, texelFetch(skin, int(vertices.y)).xyz), along(region, texelFetch(skin, int(vertices.z)).xyz));
    vec2 least = max(min(min(corners[0].xy, corners[1].xy), corners[2].xy), region.low);
    vec2 greatest = min(max(max(corners[0].xy, corners[1].xy), corners[2].xy), region.high);
    first = cell_of(region, 1 - side, least);
    last = cell_of(region, 1 - side, greatest);
    return all(lessThanEqual(least, greatest));
}
