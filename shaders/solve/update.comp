#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/held.glsl"

// Solve: p = u + beta p, s = w + beta s, x += alpha p, r -= alpha s, u = M^-1 r; a carried node has its core's x and u.
// One invocation a node.
// Oracle: oracle::step (a direct solve).

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 6) const uint CORES = 0;

layout(scalar, binding = 0) readonly buffer SolveIn { Solve solve; };
layout(binding = 1) uniform samplerBuffer image;            // w
layout(binding = 2) uniform samplerBuffer inverse;
layout(scalar, binding = 3) readonly buffer Frames { Frame frames[]; };
layout(scalar, binding = 4) readonly buffer Cores { Core cores[]; };
layout(binding = 5) uniform usamplerBuffer node_info;
layout(binding = 6) uniform samplerBuffer node_rest;
layout(scalar, binding = 7) buffer Solution { vec4 solution[]; };
layout(scalar, binding = 8) buffer Residual { vec4 residual[]; };
layout(scalar, binding = 9) buffer Preconditioned { vec4 preconditioned[]; };
layout(scalar, binding = 10) buffer Direction { vec4 direction[]; };
layout(scalar, binding = 11) buffer DirectionImage { vec4 direction_image[]; };

#include "shared/core.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    // The pass that finds convergence leaves no work here: args are zero.
    if (i >= NODES) return;
    if (CORES > 0) {
        uvec4 info = texelFetch(node_info, int(i));
        if (info.w == CARRIED) {
            uint core = frames[info.z].core;
            vec3 arm = arm_of(i, info.z);
            solution[i] = vec4(carry(cores[core].x, arm), 0.0);
            preconditioned[i] = vec4(carry(cores[core].u, arm), 0.0);
            return;
        }
    }
    vec4 p = preconditioned[i] + solve.beta * direction[i];
    vec4 s = texelFetch(image, int(i)) + solve.beta * direction_image[i];
    direction[i] = p;
    direction_image[i] = s;
    solution[i] += solve.alpha * p;
    vec4 r = residual[i] - solve.alpha * s;
    residual[i] = r;
    vec3 d = texelFetch(inverse, int(2 * i)).xyz, o = texelFetch(inverse, int(2 * i + 1)).xyz;
    preconditioned[i] = vec4(d.x * r.x + o.x * r.y + o.y * r.z, o.x * r.x + d.y * r.y + o.z * r.z,
        o.y * r.x + o.z * r.y + d.z * r.z, 0.0);
}
