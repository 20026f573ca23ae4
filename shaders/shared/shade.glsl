// Shadow lookup by percentage-closer filtering: the share of the sun's light that reaches a point. It is the share of a
// box of 3 x 3 texels around the point, interpolated between texels, in which the shadow map's depth is not in front of
// the point. An including shader declares `view` and `shadow`, the shadow map as an array: row by row, four depths in
// each vec4.

// For four neighbouring depths in a row of the shadow map, from index `first` on: 1 where the map's depth is at or
// behind `depth`, else 0.
vec4 lit_row(int first, float depth) {
    vec4 a = fetch(shadow, first >> 2), b = fetch(shadow, (first >> 2) + 1);
    int from = first & 3;
    vec4 row = from == 0 ? a : (from == 1 ? vec4(a.yzw, b.x) : (from == 2 ? vec4(a.zw, b.xy) : vec4(a.w, b.xyz)));
    return step(vec4(depth), row);
}

float lit(vec3 x, vec3 normal) {
    // The point is moved off the surface by two texels, so that neighbouring points of a slope do not shade it.
    vec3 place = (view.light * vec4(x + 2.0 * view.texel * normal, 1.0)).xyz;
    float side = float(view.shadow_side);
    vec2 texel = place.xy * side - 0.5, corner = floor(texel), share = texel - corner;
    // A point outside the shadow map is lit.
    bool is_seen = all(greaterThanEqual(corner, vec2(1.0))) && all(lessThan(corner, vec2(side - 4.0)));
    if (!is_seen) return 1.0;
    // A point behind the far plane of the shadow map is shaded by what lies in front of that plane.
    float depth = min(place.z, 1.0) - view.bias;
    int first = int(corner.y - 1.0) * int(view.shadow_side) + int(corner.x - 1.0);
    vec4 along = vec4(1.0 - share.x, 1.0, 1.0, share.x), across = vec4(1.0 - share.y, 1.0, 1.0, share.y);
    float sum = 0.0;
    for (int j = 0; j < 4; j++) sum += across[j] * dot(along, lit_row(first + j * int(view.shadow_side), depth));
    return sum / 9.0;
}
