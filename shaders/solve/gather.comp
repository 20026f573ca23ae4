#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"

// Solve: w = A p of each node from what solve/apply left, and the two inner products that follow:
//   MODE 0, warm start: w . M^-1 b, w . M^-1 w     (first = M^-1 b)
//   MODE 1, iteration:  r . u, w . u               (first = u, second = r)
//   MODE 2, at the end: (b - w) . M^-1 (b - w), 0  (second = b)
// Rows of bound nodes count for nothing; those that dynamic cores carry are summed to their core's by what follows. One invocation a node; a sum a workgroup. Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 2) const bool CONTACT = false;
layout(constant_id = 3) const uint MODE = 1;

layout(scalar, binding = 0) readonly buffer Params { StepParams params; };
layout(scalar, binding = 1) readonly buffer NodeDamping { float node_damping[]; };    // alpha m, kg/s
layout(binding = 2) uniform usamplerBuffer node_info;
layout(binding = 3) uniform samplerBuffer node_rest;
layout(binding = 4) uniform usamplerBuffer node_elements;
layout(binding = 5) uniform samplerBuffer element_forces;
layout(scalar, binding = 6) readonly buffer NodeEntries { uvec2 node_entries[]; };
layout(scalar, binding = 7) readonly buffer Sorted { uvec2 sorted[]; };
layout(binding = 8) uniform samplerBuffer contact_forces;
layout(binding = 9) uniform samplerBuffer change;           // p
layout(binding = 10) uniform samplerBuffer first;
layout(binding = 11) uniform samplerBuffer second;
layout(binding = 12) uniform samplerBuffer inverse;
layout(scalar, binding = 13) writeonly buffer Image { vec4 image[]; };      // w
layout(scalar, binding = 14) writeonly buffer Dots { vec2 dots[]; };

#include "shared/sum.glsl"
#include "shared/gather.glsl"
#include "shared/held.glsl"

vec3 precondition(uint i, vec3 b) {
    vec3 d = texelFetch(inverse, int(2 * i)).xyz, o = texelFetch(inverse, int(2 * i + 1)).xyz;
    return vec3(d.x * b.x + o.x * b.y + o.y * b.z, o.x * b.x + d.y * b.y + o.z * b.z, o.y * b.x + o.z * b.y + d.z * b.z);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    vec2 sums = vec2(0.0);
    if (i < NODES) {
        uvec4 info = texelFetch(node_info, int(i));
        vec3 w = vec3(0.0);
        if (info.w != HELD) {
            float mass = texelFetch(node_rest, int(i)).w;
            w = (mass + params.dt * node_damping[i]) * texelFetch(change, int(i)).xyz
                + gather_elements(info.x, info.y);
            if (CONTACT) {
                uvec2 run = node_entries[i];
                for (uint k = run.x; k < run.x + run.y; k++) {
                    uvec2 entry = sorted[k];
                    w += uintBitsToFloat(entry.y) * texelFetch(contact_forces, int(entry.x)).xyz;
                }
            }
            // A carried node's row counts with its core's.
            if (info.w != FREE) {
                sums = vec2(0.0);
            } else if (MODE == 0) {
                sums = vec2(dot(w, texelFetch(first, int(i)).xyz), dot(w, precondition(i, w)));
            } else if (MODE == 1) {
                vec3 u = texelFetch(first, int(i)).xyz;
                sums = vec2(dot(texelFetch(second, int(i)).xyz, u), dot(w, u));
            } else {
                vec3 residual = texelFetch(second, int(i)).xyz - w;
                sums = vec2(dot(residual, precondition(i, residual)), 0.0);
            }
        }
        image[i] = vec4(w, 0.0);
    }
    vec4 total = workgroup_sum(vec4(sums, 0.0, 0.0));
    if (gl_LocalInvocationID.x == 0) dots[gl_WorkGroupID.x] = total.xy;
}
