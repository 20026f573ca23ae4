// How much of the sun reaches a point: the mean of nine looks into the depths that the sun sees, each mixed from four texels.
// Wants `shadow` (samplerBuffer, four depths a texel, row by row) and `view`.

float lit_at(ivec2 place, float depth) {
    ivec2 inside = clamp(place, ivec2(0), ivec2(view.shadow_side - 1));
    int index = inside.y * int(view.shadow_side) + inside.x;
    return texelFetch(shadow, index >> 2)[index & 3] < depth ? 0.0 : 1.0;
}

float lit(vec3 x, vec3 normal) {
    // Off the surface by some texels: neighbours of a slope must not shade it.
    vec3 place = (view.light * vec4(x + 2.0 * view.texel * normal, 1.0)).xyz;
    if (any(lessThan(place.xy, vec2(0.0))) || any(greaterThan(place.xy, vec2(1.0)))) return 1.0;
    vec2 texel = place.xy * float(view.shadow_side) - 0.5;
    ivec2 corner = ivec2(floor(texel));
    vec2 share = texel - vec2(corner);
    float depth = place.z - view.bias;
    // Three texels a side, weighted as if the mean of 2 x 2 were taken everywhere between.
    float sum = 0.0;
    for (int j = -1; j <= 2; j++) {
        float across = j == -1 ? 1.0 - share.y : (j == 2 ? share.y : 1.0);
        for (int i = -1; i <= 2; i++) {
            float along = i == -1 ? 1.0 - share.x : (i == 2 ? share.x : 1.0);
            sum += across * along * lit_at(corner + ivec2(i, j), depth);
        }
    }
    return sum / 9.0;
}
