// Distance between two convex hulls by the algorithm of Gilbert, Johnson and Keerthi (1988), with closest points of a
// simplex as in Ericson, "Real-Time Collision Detection" (2005), chapter 5.1. An including shader declares `hull`, the
// points of all hulls.
//
// `hull_distance` returns a lower bound of the distance, so that no pair of hulls within a wanted distance is missed;
// once the iteration has converged, the bound equals the distance. Hulls a and b are at distance zero if the set of the
// differences of their points contains the origin; a simplex (point, segment, triangle or tetrahedron) has such
// differences as corners.

// The point of a hull that lies farthest along a direction.
vec3 support(uint first, uint count, vec3 direction) {
    vec3 best = fetch(hull, first).xyz;
    float value = dot(best, direction);
    for (uint i = 1; i < count; i++) {
        vec3 x = fetch(hull, first + i).xyz;
        float candidate = dot(x, direction);
        if (candidate > value) {
            value = candidate;
            best = x;
        }
    }
    return best;
}

struct Simplex {
    vec3 points[4];
    uint count;
};

// The functions closest_on_... return the closest point to the origin on a segment, a triangle or the simplex s, and
// shrink s to the vertex, edge or face that holds this point.
vec3 closest_on_segment(inout Simplex s, vec3 a, vec3 b) {
    vec3 ab = b - a;
    float t = -dot(a, ab), length2 = dot(ab, ab);
    s.points[0] = a;
    s.count = 1;
    if (t <= 0.0 || length2 == 0.0) return a;
    if (t >= length2) {
        s.points[0] = b;
        return b;
    }
    s.points[1] = b;
    s.count = 2;
    return a + (t / length2) * ab;
}

vec3 closest_on_triangle(inout Simplex s, vec3 a, vec3 b, vec3 c) {
    vec3 ab = b - a, ac = c - a;
    float d1 = -dot(ab, a), d2 = -dot(ac, a);
    if (d1 <= 0.0 && d2 <= 0.0) return closest_on_segment(s, a, a);
    float d3 = -dot(ab, b), d4 = -dot(ac, b);
    if (d3 >= 0.0 && d4 <= d3) return closest_on_segment(s, b, b);
    float vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return closest_on_segment(s, a, b);
    float d5 = -dot(ab, c), d6 = -dot(ac, c);
    if (d6 >= 0.0 && d5 <= d6) return closest_on_segment(s, c, c);
    float vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return closest_on_segment(s, a, c);
    float va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) return closest_on_segment(s, b, c);
    s.points[0] = a;
    s.points[1] = b;
    s.points[2] = c;
    s.count = 3;
    float scale = 1.0 / (va + vb + vc);
    return a + ab * (vb * scale) + ac * (vc * scale);
}

// True when the origin and d lie strictly on opposite sides of the plane of triangle abc.
bool outside(vec3 a, vec3 b, vec3 c, vec3 d) {
    vec3 n = cross(b - a, c - a);
    return dot(-a, n) * dot(d - a, n) < 0.0;
}

vec3 closest_on_simplex(inout Simplex s) {
    vec3 a = s.points[0], b = s.points[1], c = s.points[2], d = s.points[3];
    if (s.count == 1) return a;
    if (s.count == 2) return closest_on_segment(s, a, b);
    if (s.count == 3) return closest_on_triangle(s, a, b, c);
    vec3 best = vec3(0.0);
    float best2 = 3.0e38;
    Simplex kept = s;
    for (uint face = 0; face < 4; face++) {
        vec3 p = face == 3 ? b : a;
        vec3 q = face == 0 ? b : (face == 1 ? c : (face == 2 ? d : d));
        vec3 r = face == 0 ? c : (face == 1 ? d : (face == 2 ? b : c));
        vec3 other = face == 0 ? d : (face == 1 ? b : (face == 2 ? c : a));
        if (!outside(p, q, r, other)) continue;
        Simplex trial = s;
        vec3 x = closest_on_triangle(trial, p, q, r);
        if (dot(x, x) < best2) {
            best2 = dot(x, x);
            best = x;
            kept = trial;
        }
    }
    s = kept;
    return best;
}

const uint GJK_ROUNDS = 24;

// Lower bound of the distance between two hulls; iteration stops as soon as the bound exceeds `enough`.
float hull_distance(uint a_first, uint a_count, uint b_first, uint b_count, float enough) {
    Simplex s;
    vec3 v = fetch(hull, a_first).xyz - fetch(hull, b_first).xyz;
    s.points[0] = v;
    s.points[1] = s.points[2] = s.points[3] = vec3(0.0);
    s.count = 1;
    float bound = 0.0;
    for (uint round = 0; round < GJK_ROUNDS; round++) {
        float length2 = dot(v, v);
        if (length2 < 1.0e-14) return 0.0;
        vec3 w = support(a_first, a_count, -v) - support(b_first, b_count, v);
        float progress = dot(v, w);
        bound = max(bound, progress * inversesqrt(length2));
        if (bound > enough || length2 - progress <= 1.0e-6 * length2) return bound;
        s.points[s.count] = w;
        s.count += 1;
        v = closest_on_simplex(s);
        // With four corners left, the simplex contains the origin (the hulls overlap), or is too flat to decide.
        if (s.count == 4) return bound;
    }
    return bound;
}
