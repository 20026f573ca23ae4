// Colour of a mesh's surface in a rendered image: under sun and sky, or by the numbers at its vertices (vertex values),
// such as pressures. Structs and flags are in shared/look.glsl. An including shader declares `view`, `materials` and
// `colours`.

// Colour (sRGB, premultiplied by alpha) of a point x with unit normal n and vertex value `value`; `sun_share` is the
// share of the sun's light that reaches it.
vec4 surface(uint material_index, vec3 x, vec3 n, float value, float sun_share) {
    Material material = materials[material_index];
    vec3 eye = normalize(view.eye - x);
    vec4 own = material.colour;
    float evenness = 0.0;
    if ((material.flags & VALUED) != 0) {
        float share = clamp((value - material.low) / (material.high - material.low), 0.0, 1.0);
        vec3 mapped = fetch(colours, uint(share * float(SCALE_COLOURS - 1) + 0.5)).rgb;
        // Near the lower end of the scale the material's own colour shows, unless EVEN is set.
        evenness = (material.flags & EVEN) != 0 ? 1.0 : smoothstep(0.0, 0.02, share);
        own.rgb = mix(own.rgb, mapped, evenness);
    }
    if ((material.flags & NUMBERED) != 0) own.rgb = fetch(colours, SCALE_COLOURS + uint(value + 0.5) % SCALE_COLOURS).rgb;
    if ((material.flags & UNLIT) != 0) return vec4(shown(own.rgb) * own.a, own.a);
    float sun = max(dot(n, view.sun), 0.0) * ((material.flags & BARE) != 0 ? 1.0 : sun_share);
    float sky = 0.5 + 0.5 * n.y;
    // Where a colour shows a vertex value, lighting changes the colour less, so that the value can be read from it.
    vec3 light = mix(vec3(0.16, 0.16, 0.18) + sky * vec3(0.26, 0.28, 0.31) + sun * vec3(0.86, 0.82, 0.74),
                     vec3(0.62 + 0.18 * sky + 0.3 * sun), evenness);
    float glint = max(dot(n, normalize(eye + view.sun)), 0.0);
    glint *= glint;
    glint *= glint;
    glint *= glint;
    glint *= glint;
    glint = glint * glint * min(8.0 * sun, 1.0);
    vec3 bright = own.rgb * light + 0.10 * glint * (1.0 - evenness);
    float alpha = own.a;
    if ((material.flags & GLASS) != 0) {
        float rim = 1.0 - max(dot(n, eye), 0.0);
        alpha = mix(own.a, 0.95, rim * rim * rim);
        bright += 0.5 * glint;
    }
    return vec4(shown(bright) * alpha, alpha);
}
