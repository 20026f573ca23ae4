#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Cull stage (broad phase) of a step: estimates the contact normal of a pair of collision proxies (convex hulls around
// parts of skins, the bodies' surface meshes) a and b, and sums the push (depth x area x outward normal) of their
// contacts in the last step. One workgroup runs for each pair. The f64 reference implementation is
// oracle::proximity::direction. A candidate is the result of contact/candidates for one skin vertex.
//
// Over all face normals n of both hulls (oriented from a to b) the separation is s(n) = min n.y - max n.x, over the
// vertices y of hull b and x of hull a. Face normals near the greatest separation s_max are blended: the estimate is
// the sum of max(0, 1 - (s_max - s(n)) / blend)^2 n, normalised. So it turns smoothly where the best face changes, for
// separate and for overlapping hulls; the direction of least penetration would jump from face to face, and the force
// with it. The weight of the pair is max(0, reach - max(s_max, distance))^2, which vanishes at the distance `reach`
// beyond which the pair is culled.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;

layout(scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(scalar) readonly buffer Bounds { ProxyBounds bounds[]; };
READ_ONLY(uvec4, proxy_pairs);      // first proxy, second proxy
READ_ONLY(vec4, hull);
READ_ONLY(vec4, faces);             // face planes of all hulls: unit normal, offset
layout(scalar) readonly buffer ActivePairs { uint active_pairs[]; };
layout(scalar) readonly buffer Reach { vec2 reach_of[]; };     // reach and distance of the hulls of each pair, m
layout(scalar) writeonly buffer Directions { vec4 directions[]; };  // two per pair: normal, weight; push, |push|
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) readonly buffer ContactSource { uint contact_source[]; };   // candidate of each contact of the last step
READ_ONLY(uvec4, candidate_pushes);  // bits of the push of each candidate of the last step; its pair of proxies

// Most faces of both hulls together; a hull has at most 64 vertices.
const uint MAX_FACES = 256;
const float BLEND = 0.25;       // range of separations that are blended, in radii of the smaller hull

shared float separation[MAX_FACES];
shared vec4 partial[SIZE];

// The f-th face normal of both hulls, oriented from a to b.
vec3 normal_of(Proxy a, Proxy b, uint f) {
    return f < a.face_count ? fetch(faces, a.face_first + f).xyz
                            : -fetch(faces, b.face_first + f - a.face_count).xyz;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint i = active_pairs[gl_WorkGroupID.x];
    uvec4 which = fetch(proxy_pairs, i);
    Proxy a = proxies[which.x];
    Proxy b = proxies[which.y];
    uint face_count = min(a.face_count + b.face_count, MAX_FACES);
    float greatest = -3.0e38;
    for (uint f = lane; f < face_count; f += SIZE) {
        bool of_a = f < a.face_count;
        vec4 face = fetch(faces, of_a ? a.face_first + f : b.face_first + f - a.face_count);
        uint first = of_a ? b.hull_first : a.hull_first;
        uint count = of_a ? b.hull_count : a.hull_count;
        float least = 3.0e38;
        for (uint k = 0; k < count; k++) least = min(least, dot(face.xyz, fetch(hull, first + k).xyz));
        separation[f] = least - face.w;
        greatest = max(greatest, separation[f]);
    }
    partial[lane] = vec4(greatest);
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) partial[lane] = max(partial[lane], partial[lane + width]);
    }
    barrier();
    greatest = partial[0].x;
    barrier();
    float blend = BLEND * min(bounds[which.x].radius, bounds[which.y].radius);
    vec4 sum = vec4(0.0);
    for (uint f = lane; f < face_count; f += SIZE) {
        float w = max(0.0, 1.0 - (greatest - separation[f]) / blend);
        sum += w * w * vec4(normal_of(a, b, f), 1.0);
    }
    partial[lane] = sum;
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) partial[lane] += partial[lane + width];
    }
    if (lane == 0) {
        float weight = max(0.0, reach_of[i].x - max(greatest, reach_of[i].y));
        sum = partial[0];
        // Where the normals cancel (a thin plate half way through another, two boxes in one place), the first of the
        // faces with the greatest separation gives the direction.
        if (dot(sum.xyz, sum.xyz) <= 0.01 * sum.w * sum.w) {
            uint best = 0;
            while (best + 1 < face_count && separation[best] < greatest) best += 1;
            sum.xyz = normal_of(a, b, best);
        }
        directions[2 * i] = vec4(normalize(sum.xyz), weight * weight);
    }
    // Once skins touch, the contacts of the last step give a better direction, the sum of their pushes.
    vec3 push = vec3(0.0);
    for (uint c = lane; c < counts.last_contacts; c += SIZE) {
        uvec4 found = fetch(candidate_pushes, contact_source[c]);
        if (found.w == i) push += uintBitsToFloat(found.xyz);
    }
    barrier();
    partial[lane] = vec4(push, 0.0);
    for (uint width = SIZE / 2; width > 0; width /= 2) {
        barrier();
        if (lane < width) partial[lane] += partial[lane + width];
    }
    if (lane == 0) directions[2 * i + 1] = vec4(partial[0].xyz, length(partial[0].xyz));
}
