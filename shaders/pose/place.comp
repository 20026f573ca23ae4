#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/types.glsl"
#include "shared/args.glsl"
#include "shared/rotation.glsl"

// Pose: hull vertices and face planes of all proxies into the world, x = c + R r, n = R n_rest, offset = n_rest . r + n . c.
// One invocation a hull vertex, then one a face; the first also clears the step's counters and indirect arguments.
// Oracle: oracle::proximity::place.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint HULL_VERTICES = 1;
layout(constant_id = 2) const uint FACES = 1;
layout(constant_id = 3) const uint TETRAHEDRA = 0;

layout(scalar, binding = 0) readonly buffer Frames { Frame frames[]; };
layout(binding = 1) uniform samplerBuffer hull_rest;        // xyz, frame in w
layout(binding = 2) uniform samplerBuffer face_rest;        // unit normal, offset
layout(binding = 3) uniform usamplerBuffer face_frame;      // frame in x
layout(scalar, binding = 4) writeonly buffer Hull { vec4 hull[]; };
layout(scalar, binding = 5) writeonly buffer Faces { vec4 faces[]; };
layout(scalar, binding = 6) writeonly buffer CountsOut { Counts counts; };
layout(scalar, binding = 7) writeonly buffer Args { uint args[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i == 0) {
        counts = Counts(0, 0, 0, 0, 0, 0, 0, 0);
        for (uint k = 0; k < ARGS_LOOP_APPLY; k++) {
            args[3 * k] = 0;
            args[3 * k + 1] = 1;
            args[3 * k + 2] = 1;
        }
        args[3 * ARGS_APPLY] = groups_of(TETRAHEDRA);
    }
    if (i < HULL_VERTICES) {
        vec4 rest = texelFetch(hull_rest, int(i));
        Frame frame = frames[uint(rest.w)];
        hull[i] = vec4(frame.centre + rotate(frame.rotation, rest.xyz), 0.0);
    } else if (i < HULL_VERTICES + FACES) {
        uint f = i - HULL_VERTICES;
        vec4 rest = texelFetch(face_rest, int(f));
        Frame frame = frames[texelFetch(face_frame, int(f)).x];
        vec3 n = rotate(frame.rotation, rest.xyz);
        faces[f] = vec4(n, rest.w + dot(n, frame.centre));
    }
}
