#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Test of shared/patch_product.glsl by itself; stands in no step. One invocation a patch.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PATCHES = 0;
layout(constant_id = 2) const uint TETRAHEDRA = 0;

layout(binding = 0) uniform usamplerBuffer patch_nodes;
layout(binding = 1) uniform samplerBuffer patch_rows;
layout(binding = 2) uniform samplerBuffer change;
layout(scalar, binding = 3) writeonly buffer ElementForces { vec4 element_forces[]; };

#include "shared/patch.glsl"
#include "shared/patch_product.glsl"

void main() {
    if (gl_GlobalInvocationID.x < PATCHES) apply_patch(gl_GlobalInvocationID.x);
}
