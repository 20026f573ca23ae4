#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Solve: right-hand side b = h m g - h alpha m v + sum (h f - (h^2 + h beta) K v) - sum w ((h a k delta + (h^2 k + h d) a delta') n + h c v_t)
// of each node, plus
// what the last solve left undone (its b - A x: impulse that would be lost, step by step in the same smooth shapes, since a
// warm start leaves those to the end); the inverse of its 3x3 diagonal block of A, and their sums b . M^-1 b and (e . M^-1 e) eps^2, e the sum of
// the magnitudes that b is made of: what rounding leaves of b at rest. Nodes on a core whose motion is known keep zero
// blocks, so the solver never moves them; those that dynamic cores carry keep their blocks as they are, for the core's. One invocation a node; a sum a workgroup. Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 7) const bool FRICTION = false;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer NodeDamping { float node_damping[]; };    // alpha m, kg/s
layout(binding = 2) uniform usamplerBuffer node_info;       // first quad of elements, quads, frame, and who holds it (shared/held.glsl)
layout(binding = 3) uniform samplerBuffer node_rest;        // w: mass, kg
layout(binding = 4) uniform samplerBuffer velocity;
layout(binding = 5) uniform usamplerBuffer node_elements;
layout(binding = 6) uniform samplerBuffer element_forces;
layout(binding = 7) uniform samplerBuffer gradients;
layout(scalar, binding = 8) readonly buffer NodeEntries { uvec2 node_entries[]; };
layout(scalar, binding = 9) readonly buffer Sorted { uvec2 sorted[]; };
layout(scalar, binding = 10) readonly buffer Contacts { Contact contacts[]; };
layout(binding = 11) uniform samplerBuffer leftover;        // b - A x of the last step
layout(scalar, binding = 12) writeonly buffer Rhs { vec4 rhs[]; };
layout(scalar, binding = 13) writeonly buffer Preconditioned { vec4 preconditioned[]; };     // M^-1 b
layout(scalar, binding = 14) writeonly buffer Inverse { vec4 inverse[]; };      // two a node: xx yy zz, xy xz yz
layout(scalar, binding = 15) writeonly buffer Partials { vec2 partials[]; };

#include "shared/sum.glsl"
#include "shared/held.glsl"

// Half a unit in the last place of f32, for each of a handful of roundings on the way to b.
const float ROUNDING = 1.0e-7;

// Inverse of a symmetric 3x3 matrix, xx yy zz and xy xz yz, by cofactors.
void invert(vec3 a, vec3 c, out vec3 diagonal, out vec3 off) {
    vec3 co = vec3(a.y * a.z - c.z * c.z, c.y * c.z - c.x * a.z, c.x * c.z - c.y * a.y);
    float determinant = a.x * co.x + c.x * co.y + c.y * co.z;
    diagonal = vec3(co.x, a.x * a.z - c.y * c.y, a.x * a.y - c.x * c.x) / determinant;
    off = vec3(co.y, co.z, c.x * c.y - a.x * c.z) / determinant;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    vec2 sums = vec2(0.0);
    if (i < NODES) {
        uvec4 info = texelFetch(node_info, int(i));
        vec3 b = vec3(0.0), z = vec3(0.0), diagonal = vec3(0.0), off = vec3(0.0);
        if (info.w != HELD) {
            float h = params.dt, mass = texelFetch(node_rest, int(i)).w, damping = node_damping[i];
            vec3 v = texelFetch(velocity, int(i)).xyz;
            b = h * (mass * params.gravity - damping * v) + texelFetch(leftover, int(i)).xyz;
            vec3 e = abs(h * mass * params.gravity) + abs(h * damping * v);
            // The block: xx yy zz in `a`, xy xz yz in `c`.
            vec3 a = vec3(mass + h * damping), c = vec3(0.0);
            for (uint k = 0; k < info.y; k++) {
                uvec4 entries = texelFetch(node_elements, int(info.x + k));
                for (uint l = 0; l < 4; l++) {
                    uint entry = entries[l];
                    vec3 f = texelFetch(element_forces, int(entry)).xyz;
                    b += f;
                    e += abs(f);
                    int t = int(entry / 4);
                    vec4 g1 = texelFetch(gradients, 3 * t), g2 = texelFetch(gradients, 3 * t + 1);
                    vec3 g3 = texelFetch(gradients, 3 * t + 2).xyz;
                    uint corner = entry % 4;
                    vec3 g = corner == 0 ? -g1.xyz - g2.xyz - g3 : (corner == 1 ? g1.xyz : (corner == 2 ? g2.xyz : g3));
                    a += g1.w * dot(g, g) + (g1.w + g2.w) * g * g;
                    c += (g1.w + g2.w) * g.xxy * g.yzz;
                }
            }
            if (CONTACT) {
                uvec2 run = node_entries[i];
                for (uint k = run.x; k < run.x + run.y;) {
                    uint touching = sorted[k].x;
                    Contact contact = contacts[touching];
                    // The tetrahedra behind a triangle's corners share nodes: a contact's entries at a node, which stand
                    // together, are one weight, and the block holds its square.
                    float w = 0.0;
                    for (; k < run.x + run.y && sorted[k].x == touching; k++) w += uintBitsToFloat(sorted[k].y);
                    float g = h * (h * contact.stiffness + contact.damping) * contact.area;
                    float f = w * (h * contact.area * contact.stiffness * contact.depth + g * contact.rate);
                    vec3 n = contact.normal;
                    b -= f * n;
                    e += abs(f * n);
                    a += g * w * w * n * n;
                    c += g * w * w * n.xxy * n.yzz;
                    if (FRICTION) {
                        // I - n n^T.
                        float viscous = h * contact.friction;
                        b -= w * viscous * contact.slip;
                        e += abs(w * viscous * contact.slip);
                        a += viscous * w * w * (1.0 - n * n);
                        c -= viscous * w * w * n.xxy * n.yzz;
                    }
                }
            }
            if (info.w == CARRIED) {
                diagonal = a;
                off = c;
            } else {
                invert(a, c, diagonal, off);
                z = vec3(diagonal.x * b.x + off.x * b.y + off.y * b.z, off.x * b.x + diagonal.y * b.y + off.z * b.z,
                    off.y * b.x + off.z * b.y + diagonal.z * b.z);
                sums = vec2(dot(b, z), ROUNDING * dot(e, ROUNDING * e * diagonal));
            }
        }
        rhs[i] = vec4(b, 0.0);
        preconditioned[i] = vec4(z, 0.0);
        inverse[2 * i] = vec4(diagonal, 0.0);
        inverse[2 * i + 1] = vec4(off, 0.0);
    }
    vec4 total = workgroup_sum(vec4(sums, 0.0, 0.0));
    if (gl_LocalInvocationID.x == 0) partials[gl_WorkGroupID.x] = total.xy;
}
