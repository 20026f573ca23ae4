// The material law: the one place where a tetrahedron's stress, the operator's moduli and the energy density are computed from
// its strain E, F = R (I + E). Every law is linear elasticity of mu and lambda where strain is small. A further law has an id
// here, a branch in `evaluate` and in `energy_density`, its name in scene/material.rs, its id and parameters in
// stages/material_law.rs, and its branches in oracle::material_law; what parameters it needs besides mu and lambda are in
// ElasticMaterial. Needs shared/types.glsl, shared/strain.glsl and LAWS.
// Oracle: oracle::material_law.

const uint LAW_COROTATIONAL = 0;
const uint LAW_NEO_HOOKEAN = 1;

// What an element takes from its law.
struct Evaluation {
    mat3 stress;        // R^T P, Pa
    float mu;           // of the operator, Pa: 2 mu |sym L|^2 + lambda tr(L)^2 of L = dF (R fold)^-1
    float lambda;
    mat3 fold;          // gradients that the operator acts on, from those at rest
};

float trace(mat3 a) {
    return a[0][0] + a[1][1] + a[2][2];
}

float square(mat3 a) {
    return dot(a[0], a[0]) + dot(a[1], a[1]) + dot(a[2], a[2]);
}

// 2 mu sym(E) + lambda tr(E) I.
mat3 linear_stress(mat3 e, float mu, float lambda) {
    float pressure = lambda * (e[0][0] + e[1][1] + e[2][2]);
    return mu * (e + transpose(e)) + mat3(pressure, 0, 0, 0, pressure, 0, 0, 0, pressure);
}

// Modulus of the compression penalty, Pa: a principal stretch s below LEAST adds this times (s - LEAST) along its axis, since
// corotational elasticity alone lets a tetrahedron be pressed flat and turn inside out.
float compression_modulus(ElasticMaterial material) { return STIFFENING * (material.lambda + 2.0 * material.mu); }

#include "shared/neo_hookean.glsl"

// Whether any material of the scene has a law: what no scene needs is not compiled.
bool is_used(uint law) { return (LAWS & (1u << law)) != 0; }

// `squeezed`: of the strain (shared/strain.glsl). `lambda`: the element's own, zero where it acts by patches (elastic/dilate).
// The operator gets half of the compression penalty as shear modulus, isotropic and at least as stiff. A law that is not
// known, or not compiled, is no number, so that the step is not accepted and its flag says so.
Evaluation evaluate(ElasticMaterial material, mat3 e, mat3 squeezed, float lambda) {
    Evaluation law;
    if (is_used(LAW_COROTATIONAL) && material.law == LAW_COROTATIONAL) {
        law.stress = linear_stress(e, material.mu, lambda);
        law.mu = squeezed == mat3(0.0) ? material.mu : material.mu + 0.5 * compression_modulus(material);
        law.lambda = lambda;
        law.fold = mat3(1.0);
    } else if (is_used(LAW_NEO_HOOKEAN) && material.law == LAW_NEO_HOOKEAN) {
        law = neo_hookean(e, material, squeezed);
    } else {
        law.mu = law.lambda = uintBitsToFloat(0x7fc00000u);
        law.stress = law.fold = mat3(law.mu);
    }
    law.stress += compression_modulus(material) * squeezed;
    return law;
}

// Energy density, J/m^3, zero at rest; without the part of lambda that acts by patches.
float energy_density(ElasticMaterial material, mat3 e, mat3 squeezed, float lambda) {
    float density = uintBitsToFloat(0x7fc00000u);
    if (is_used(LAW_COROTATIONAL) && material.law == LAW_COROTATIONAL) {
        mat3 even = 0.5 * (e + transpose(e));
        float tr = trace(e);
        density = material.mu * square(even) + 0.5 * lambda * tr * tr;
    } else if (is_used(LAW_NEO_HOOKEAN) && material.law == LAW_NEO_HOOKEAN) {
        density = neo_hookean_energy(e, material.mu, material.lambda);
    }
    return density + 0.5 * compression_modulus(material) * square(squeezed);
}
