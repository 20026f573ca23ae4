#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

// Draw stage (for display, not part of a step): adds lambda / 2 theta^2 to the energy density of each tetrahedron of an
// F-bar patch (group of tetrahedra that share one volumetric strain, elastic/mean_dilatation), and leaves the patch's
// part of its stress, lambda theta, in place of lambda. Here lambda is Lame's first parameter of the tetrahedron, and
// theta = sum V tr(E) / sum V is the patch's mean dilatation, over the volumes V and strains E of its tetrahedra. One
// invocation runs for each patch; no two patches share a tetrahedron. The f64 reference implementation is
// oracle::elastic::Elements::densities.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PATCHES = 0;

layout(scalar) readonly buffer PatchFirst { uint patch_first[]; };  // start of a patch in `patch_members`, then the end
layout(scalar) readonly buffer PatchMembers { uint patch_members[]; };        // tetrahedra of each patch
layout(scalar) buffer Densities { vec4 densities[]; };  // J/m^3; V, m^3; tr(E); lambda, then lambda theta, Pa

void main() {
    uint p = gl_GlobalInvocationID.x;
    if (p >= PATCHES) return;
    float change = 0.0, volume = 0.0;
    for (uint k = patch_first[p]; k < patch_first[p + 1]; k++) {
        vec4 own = densities[patch_members[k]];
        change += own.y * own.z;
        volume += own.y;
    }
    float theta = volume > 0.0 ? change / volume : 0.0;
    for (uint k = patch_first[p]; k < patch_first[p + 1]; k++) {
        float stress = densities[patch_members[k]].w * theta;
        densities[patch_members[k]].x += 0.5 * stress * theta;
        densities[patch_members[k]].w = stress;
    }
}
