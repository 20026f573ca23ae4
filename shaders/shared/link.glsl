// Displacements across frames. Needs shared/types.glsl and shared/rotation.glsl.

// (Q - I) p from the vector part, so that a small turn keeps its digits.
vec3 turned(vec4 q, vec3 p) { return 2.0 * cross(q.xyz, cross(q.xyz, p) + q.w * p); }

// In the link's first frame, the displacement of a point at rest r + displaced by d in its second.
vec3 across(Link link, vec3 r, vec3 d) { return link.offset + turned(link.turn, r + d) + d; }
