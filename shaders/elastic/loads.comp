#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Elastic stage: sums the loads on each target, which is a node, the force on a dynamic core, or the torque on one (a
// rigid part that forces move). A source is a vector that the host writes for each step: a force, a force per area or a
// torque. One invocation runs for each target, whose sum is in the order of the scene's loads. The f64 reference is
// oracle::loads.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint TARGETS = 0;
layout(constant_id = 2) const uint SOURCES = 0;

READ_ONLY(vec4, load_sources);
READ_ONLY(vec4, triangle_forces);           // forces of pressures on triangles, N, from elastic/pressures
layout(scalar) readonly buffer LoadTargets { uvec3 load_targets[]; };      // place in external_forces; range of entries
layout(scalar) readonly buffer LoadEntries { uvec2 load_entries[]; };      // source, or triangle behind the sources; factor
layout(scalar) writeonly buffer ExternalForces { vec4 external_forces[]; };

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= TARGETS) return;
    uvec3 target = load_targets[k];
    vec3 sum = vec3(0.0);
    for (uint e = target.y; e < target.y + target.z; e++) {
        uvec2 entry = load_entries[e];
        vec3 force = vec3(0.0);
        if (entry.x < SOURCES) force = fetch(load_sources, entry.x).xyz;
        else force = fetch(triangle_forces, entry.x - SOURCES).xyz;
        sum += uintBitsToFloat(entry.y) * force;
    }
    external_forces[target.x] = vec4(sum, 0.0);
}
