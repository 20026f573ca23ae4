#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"
#include "shared/symmetric.glsl"
#include "shared/geometric.glsl"

// Elastic stage of a step: F-bar patches, groups of tetrahedra that share one volumetric strain against volumetric
// locking (de Souza Neto, Andrade Pires and Owen 2005). The shared strain of the tetrahedra e of a patch is the mean
// dilatation theta = sum V_e tr(E_e) / V, with volumes V_e, their sum V, and strains E_e.
//
// In the operator (h^2 + h beta) K, with the step h, the stiffness K and stiffness-proportional damping beta, a patch
// adds a matrix c c^T over its nodes j, c_j = sqrt((h^2 + h beta) lambda / V) sum sqrt(V_e) g'_ej, with Lame's first
// parameter lambda, and the scaled gradient g'_ej of tetrahedron e at node j (elastic/element_forces). With elastic
// forces f and node velocities v, the right-hand side gets h f - (h^2 + h beta) K v = -(h theta sqrt(lambda V / (h^2 +
// h beta)) + c . v) c. In later Newton iterations another velocity takes the place of v (shared/lag.glsl). The kernel
// runs after elastic/element_forces; solve/patch_product uses the rows c in every conjugate gradient iteration. One
// invocation runs for each patch. The f64 reference implementation is oracle::elastic.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PATCHES = 0;
layout(constant_id = 2) const uint TETRAHEDRA = 0;
layout(constant_id = 5) const bool NEWTON = false;       // whether this is a later Newton iteration

layout(scalar) uniform Params { StepParams params; };
READ_ONLY(uvec4, patch_nodes);         // three texels per patch: its nodes, padded with its first node
READ_ONLY(uvec4, patch_members);  // two tetrahedra a texel: index; numbers of its four nodes in the patch, 4 bits each
READ_ONLY(vec4, patch_constants);      // V (m^3), lambda (Pa), beta (s)
READ_ONLY(vec4, rest_gradients);       // three per tetrahedron; w of the first: sqrt(V_e)
READ_ONLY(vec4, gradients);  // GRADIENT_TEXELS per tetrahedron, then as many zero vectors; w of the third: tr(E)
READ_ONLY(vec4, velocity);
READ_ONLY(vec4, trial_change);
layout(scalar) writeonly buffer PatchRows { vec4 patch_rows[]; };          // c: a vector for each of a patch's nodes
layout(scalar) writeonly buffer ElementForces { vec4 element_forces[]; };  // N s; tetrahedra's entries, then patches'

#include "shared/f_bar_patch.glsl"
#include "shared/lag.glsl"


void main() {
    uint p = gl_GlobalInvocationID.x;
    if (p >= PATCHES) return;
    vec3 row[PATCH_NODES];
    for (uint k = 0; k < PATCH_NODES; k++) row[k] = vec3(0.0);
    float strain = 0.0;
    for (uint k = 0; k < PATCH_TETRAHEDRA; k++) {
        uvec4 pair = fetch(patch_members, PATCHES * (k / 2) + p);
        uvec2 member = half_of(pair, k);
        uint t = member.x;
        float root = fetch(rest_gradients, 3 * t).w;
        uint first = GRADIENT_TEXELS * t;
        vec3 g1 = fetch(gradients, first).xyz, g2 = fetch(gradients, first + 1).xyz;
        vec4 g3 = fetch(gradients, first + 2);
        row[member.y & 15] -= root * (g1 + g2 + g3.xyz);
        row[member.y >> 4 & 15] += root * g1;
        row[member.y >> 8 & 15] += root * g2;
        row[member.y >> 12 & 15] += root * g3.xyz;
        strain += root * root * g3.w;
    }
    vec3 constants = fetch(patch_constants, p).xyz;
    float volume = constants.x, lambda = constants.y, beta = constants.z, step = params.dt * (params.dt + beta);
    float scale = sqrt(step * lambda / volume);
    vec3 v0 = lag(patch_quad(p, 0).x, beta);
    float along = params.dt * strain * sqrt(lambda / (step * volume));
    row[0] = vec3(0.0);
    for (uint k = 1; k < PATCH_NODES; k++) {
        row[k] *= scale;
        row[0] -= row[k];
        along += dot(row[k], lag(patch_quad(p, k / 4)[k % 4], beta) - v0);
    }
    for (uint k = 0; k < PATCH_NODES; k++) {
        patch_rows[patch_row(p, k)] = vec4(row[k], 0.0);
        element_forces[patch_entry(p, k)] = vec4(-along * row[k], 0.0);
    }
}
