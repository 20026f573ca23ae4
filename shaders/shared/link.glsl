// Converts displacements from one rigid coordinate frame to another by a `Link`, the relative placement of two frames.
// Links are two texels each. An including shader includes shared/types.glsl and shared/rotation.glsl.

// (Q - I) p for the rotation Q of the unit quaternion q, computed without differences of nearly equal numbers, so that
// a small rotation keeps its digits.
vec3 turned(vec4 q, vec3 p) { return 2.0 * cross(q.xyz, cross(q.xyz, p) + q.w * p); }

// Displacement, in the frame that the link leads to, of a node at rest position r with displacement d in its own frame.
vec3 across(Link link, vec3 r, vec3 d) { return link.offset + turned(link.turn, r + d) + d; }

// Reads a link of the array `links` of vec4, which an including shader declares.
#define link_at(index) Link(fetch(links, 2 * (index)), fetch(links, 2 * (index) + 1).xyz, 0.0)
