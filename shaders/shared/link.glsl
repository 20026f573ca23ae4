// Displacements across frames. Needs shared/types.glsl and shared/rotation.glsl.

// (Q - I) p from the vector part of the quaternion, so that a small rotation keeps its digits.
vec3 turned(vec4 q, vec3 p) { return 2.0 * cross(q.xyz, cross(q.xyz, p) + q.w * p); }

// Displacement in the link's first frame of a node at rest position r whose displacement in the second frame is d.
vec3 across(Link link, vec3 r, vec3 d) { return link.offset + turned(link.turn, r + d) + d; }
