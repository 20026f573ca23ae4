// The exact triangle that a vertex's ray along the region's normal meets: from the texel's triangle over edge neighbours
// towards the ray, until its barycentric coordinates there are all non-negative. Needs `triangles`, `neighbours`, `skin`.

const uint WALK_STEPS = 64;

struct Hit {
    uint triangle;              // NONE: none found
    vec3 barycentric;
    vec3 point;
    float guess;                // depth by the first triangle, extended where its rim is passed; for flags only
    bool lost;                  // the walk left the patch
};

vec2 project(Region region, vec3 x) { return vec2(dot(x, region.tangent), dot(x, region.bitangent)); }

// `stamp` is this step's number, as skin positions carry it.
Hit walk(Region region, bool side_b, uint start, vec3 x, float stamp) {
    Hit hit = Hit(NONE, vec3(0.0), vec3(0.0), 0.0, false);
    uint triangle = start;
    for (uint k = 0; k < WALK_STEPS; k++) {
        uvec3 corners = texelFetch(triangles, int(triangle)).xyz;
        vec4 p4 = texelFetch(skin, int(corners.x)), q4 = texelFetch(skin, int(corners.y)), r4 = texelFetch(skin, int(corners.z));
        // Relative to the ray, so that the barycentric coordinates keep their digits.
        precise vec2 p = project(region, p4.xyz - x), q = project(region, q4.xyz - x), r = project(region, r4.xyz - x);
        // `precise` keeps an edge's product exactly opposite in both its triangles: no ray slips between them.
        precise vec3 b = vec3(q.x * r.y - q.y * r.x, r.x * p.y - r.y * p.x, p.x * q.y - p.y * q.x);
        float area = b.x + b.y + b.z;
        bool faces_other = side_b ? area < 0.0 : area > 0.0;
        if (!faces_other || p4.w != stamp || q4.w != stamp || r4.w != stamp) {
            hit.lost = true;
            return hit;
        }
        b /= area;
        if (k == 0) {
            vec3 inside = max(b, vec3(0.0));
            inside /= inside.x + inside.y + inside.z;
            hit.guess = dot(region.normal, inside.x * (p4.xyz - x) + inside.y * (q4.xyz - x) + inside.z * (r4.xyz - x));
        }
        if (all(greaterThanEqual(b, vec3(0.0)))) {
            hit.triangle = triangle;
            hit.barycentric = b;
            hit.point = b.x * (p4.xyz - x) + b.y * (q4.xyz - x) + b.z * (r4.xyz - x);
            return hit;
        }
        uvec3 across = texelFetch(neighbours, int(triangle)).xyz;
        // Edge k runs from corner k to corner k + 1: opposite corner k + 2.
        uint next = b.x <= b.y && b.x <= b.z ? across.y : (b.y <= b.z ? across.z : across.x);
        if (next == NONE) {
            hit.lost = true;
            return hit;
        }
        triangle = next;
    }
    hit.lost = true;
    return hit;
}
