#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/rotation.glsl"
#include "shared/held.glsl"

// Solve: the first iterate. x = warm x, r = b - warm A x, u = M^-1 r, search directions zero; a carried node has its core's. One invocation a node.
// Oracle: oracle::step.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint NODES = 0;
layout(constant_id = 6) const uint CORES = 0;

layout(scalar, binding = 0) readonly buffer SolveIn { Solve solve; };
layout(binding = 1) uniform samplerBuffer rhs;
layout(binding = 2) uniform samplerBuffer image;            // A x
layout(binding = 3) uniform samplerBuffer inverse;
layout(scalar, binding = 4) readonly buffer Frames { Frame frames[]; };
layout(scalar, binding = 5) readonly buffer Cores { Core cores[]; };
layout(binding = 6) uniform usamplerBuffer node_info;
layout(binding = 7) uniform samplerBuffer node_rest;
layout(scalar, binding = 8) buffer Solution { vec4 solution[]; };
layout(scalar, binding = 9) writeonly buffer Residual { vec4 residual[]; };
layout(scalar, binding = 10) writeonly buffer Preconditioned { vec4 preconditioned[]; };
layout(scalar, binding = 11) writeonly buffer Direction { vec4 direction[]; };
layout(scalar, binding = 12) writeonly buffer DirectionImage { vec4 direction_image[]; };

#include "shared/core.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= NODES) return;
    direction[i] = vec4(0.0);
    direction_image[i] = vec4(0.0);
    if (CORES > 0) {
        uvec4 info = texelFetch(node_info, int(i));
        if (info.w == CARRIED) {
            uint core = frames[info.z].core;
            vec3 arm = arm_of(i, info.z);
            solution[i] = vec4(carry(cores[core].x, arm), 0.0);
            preconditioned[i] = vec4(carry(cores[core].u, arm), 0.0);
            residual[i] = vec4(0.0);
            return;
        }
    }
    vec3 r = texelFetch(rhs, int(i)).xyz;
    // Not a product with zero: what is left of a failed step may not be a number.
    if (solve.warm != 0.0) r -= solve.warm * texelFetch(image, int(i)).xyz;
    vec3 d = texelFetch(inverse, int(2 * i)).xyz, o = texelFetch(inverse, int(2 * i + 1)).xyz;
    solution[i] = solve.warm != 0.0 ? solve.warm * solution[i] : vec4(0.0);
    residual[i] = vec4(r, 0.0);
    preconditioned[i] = vec4(d.x * r.x + o.x * r.y + o.y * r.z, o.x * r.x + d.y * r.y + o.z * r.z,
        o.y * r.x + o.z * r.y + d.z * r.z, 0.0);
}
