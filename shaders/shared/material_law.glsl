// The material law: the one place where the shaders compute a tetrahedron's stress, the moduli of the solver's operator
// and the energy density. All three follow from the tetrahedron's strain E; its deformation gradient is F = R (I + E)
// with the polar rotation R. At small strain every law is linear elasticity with Lame parameters mu and lambda.
//
// A new law needs an id here, a branch in `evaluate` and in `energy_density`, a name in scene/material.rs, its id and
// parameters in stages/material_law.rs, and branches in oracle::material_law, the f64 reference. Its parameters besides
// mu and lambda are in ElasticMaterial. An including shader includes shared/types.glsl, shared/strain.glsl,
// shared/symmetric.glsl and shared/geometric.glsl, and declares LAWS, with a bit for each law that some material has.

const uint LAW_COROTATIONAL = 0;      // corotational linear elasticity
const uint LAW_NEO_HOOKEAN = 1;       // stable neo-Hookean elasticity

// Stress and stiffness of a tetrahedron by its material law. With dF a change of F, the operator is the quadratic form
// 2 mu |sym L|^2 + lambda tr(L)^2 + w^T geometric w (a volume density) of L = dF (R fold)^T, with w the axial vector of
// the skew part of L.
struct Evaluation {
    mat3 stress;        // R^T P, with the first Piola-Kirchhoff stress P, Pa
    float mu;           // shear modulus of the operator, Pa
    float lambda;       // first Lame parameter of the operator, Pa
    mat3 fold;          // maps the rest gradients of shape functions to those that the operator uses
    mat3 geometric;     // geometric stiffness, Pa: symmetric and positive semi-definite
    mat3 exact;         // geometric stiffness with its negative eigenvalues, Pa; zero if is_partial
    bool is_partial;    // whether an F-bar patch applies the pressure, so that the stress here is not the whole
};

float trace(mat3 a) {
    return a[0][0] + a[1][1] + a[2][2];
}

// Square of the Frobenius norm.
float square(mat3 a) {
    return dot(a[0], a[0]) + dot(a[1], a[1]) + dot(a[2], a[2]);
}

// Stress of linear elasticity: 2 mu sym(E) + lambda tr(E) I.
mat3 linear_stress(mat3 e, float mu, float lambda) {
    float pressure = lambda * (e[0][0] + e[1][1] + e[2][2]);
    return mu * (e + transpose(e)) + mat3(pressure, 0, 0, 0, pressure, 0, 0, 0, pressure);
}

// The compression penalty. Principal stretches s below LEAST (shared/strain.glsl) add a stress along their axes, because
// corotational elasticity alone lets a tetrahedron be pressed flat and turn inside out. With the excess compression C,
// the matrix of all (s - LEAST), and its norm x = |C|, the penalty's energy density has the second derivative
// modulus * min(1, x / ONSET) in x: it starts without a jump, so that rounding of a stretch near LEAST changes nothing.
float greatest_modulus(ElasticMaterial material) { return STIFFENING * (material.lambda + 2.0 * material.mu); }

// Share of its greatest modulus that the compression penalty has.
float penalty_share(mat3 compression) { return min(1.0, sqrt(square(compression)) / ONSET); }

// Modulus of the compression penalty, Pa, a bound of its stiffness in every direction.
float compression_modulus(ElasticMaterial material, mat3 compression) {
    return penalty_share(compression) * greatest_modulus(material);
}

// Stress of the compression penalty, R^T P, Pa.
mat3 penalty_stress(ElasticMaterial material, mat3 compression) {
    float x = sqrt(square(compression));
    float secant = x < ONSET ? 0.5 * x / ONSET : 1.0 - 0.5 * ONSET / x;
    return (secant * greatest_modulus(material)) * compression;
}

// Energy density of the compression penalty, J/m^3.
float penalty_energy(ElasticMaterial material, mat3 compression) {
    float x = sqrt(square(compression));
    float density = x < ONSET ? x * x * x / (6.0 * ONSET) : 0.5 * x * (x - ONSET) + ONSET * ONSET / 6.0;
    return density * greatest_modulus(material);
}

#include "shared/neo_hookean.glsl"

// Whether any material of the scene has this law; a kernel is compiled without the code of unused laws.
bool is_used(uint law) { return (LAWS & (1u << law)) != 0; }

mat3 even_part(mat3 a) { return 0.5 * (a + transpose(a)); }

// Geometric stiffness Z of a law with the given stress R^T P, negative eigenvalues included. For a change dF of F, the
// second derivative of the energy of any objective law contains w^T Z w, with w the axial vector of the skew part of L:
// for L = dF F^-1, Z = tr(t) I - t with Kirchhoff's stress t = P F^T; for L = dF R^T, as the corotational law's operator
// has it, an isotropic law with P = R s and F = R S has Z = 2 (tr(s) I - s) (tr(S) I - S)^-1.
mat3 geometric_stiffness(uint law, mat3 e, mat3 compression, mat3 stress) {
    mat3 stretch = mat3(1.0) + even_part(e) - compression;
    if (is_used(LAW_NEO_HOOKEAN) && law == LAW_NEO_HOOKEAN) {
        mat3 t = even_part(stress * stretch);
        return mat3(trace(t)) - t;
    }
    mat3 s = even_part(stress);
    return even_part(2.0 * (mat3(trace(s)) - s) * inverse(mat3(trace(stretch)) - stretch));
}

// Product of a law's operator, with the given geometric stiffness, and the rate of F.
mat3 operator_rate(Evaluation law, mat3 geometric, mat3 rate) {
    mat3 w = rate * law.fold;
    return (linear_stress(w, law.mu, law.lambda) + 0.25 * cross_matrix(geometric * twice_axial(w))) * law.fold;
}

// Rate R^T dP/dt (Pa/s) at which the stress changes while F changes at the rate R `rate`: the exact derivative. Where
// the compression penalty acts, the energy may have a negative curvature, along which one linearisation would run away;
// the rate is that of the operator there, as for a tetrahedron of an F-bar patch, and in between where the penalty
// starts, where the exact rate of the neo-Hookean law leaves the penalty out. `law` is the evaluation at `e`.
mat3 stress_rate(ElasticMaterial material, mat3 e, mat3 compression, Evaluation law, mat3 rate) {
    float inexact = law.is_partial ? 1.0 : penalty_share(compression);
    if (is_used(LAW_NEO_HOOKEAN) && material.law == LAW_NEO_HOOKEAN) {
        return inexact * operator_rate(law, law.geometric, rate) + (1.0 - inexact) * neo_hookean_rate(e, material, rate);
    }
    return operator_rate(law, inexact * law.geometric + (1.0 - inexact) * law.exact, rate);
}

// Evaluates a material's law at the strain `e`. `compression` is the part of the strain that the compression penalty
// acts on (`excess_compression` in shared/strain.glsl). `lambda` is the material's, or zero where an F-bar patch
// (tetrahedra that share one volumetric strain, elastic/mean_dilatation) applies lambda instead. The operator of the
// corotational law gets half of the penalty's modulus as shear modulus, which is isotropic and at least as stiff as
// the penalty. A law that is unknown, or not compiled, gives NaN, so that the step is rejected and a flag reports it.
Evaluation evaluate(ElasticMaterial material, mat3 e, mat3 compression, float lambda) {
    Evaluation law;
    if (is_used(LAW_COROTATIONAL) && material.law == LAW_COROTATIONAL) {
        law.stress = linear_stress(e, material.mu, lambda);
        law.mu = material.mu + 0.5 * compression_modulus(material, compression);
        law.lambda = lambda;
        law.fold = mat3(1.0);
    } else if (is_used(LAW_NEO_HOOKEAN) && material.law == LAW_NEO_HOOKEAN) {
        law = neo_hookean(e, material, compression);
    } else {
        law.mu = law.lambda = uintBitsToFloat(0x7fc00000u);
        law.stress = law.fold = mat3(law.mu);
    }
    law.stress += penalty_stress(material, compression);
    // What is pressed would turn by itself; the operator must stay positive semi-definite. A part of the stress has no
    // geometric stiffness that would leave rigid rotation free.
    law.is_partial = lambda != material.lambda;
    law.exact = mat3(0.0);
    if (!law.is_partial) law.exact = geometric_stiffness(material.law, e, compression, law.stress);
    law.geometric = positive_part(law.exact);
    return law;
}

// Energy density of a law, J/m^3, zero at rest, without the part of lambda that acts through F-bar patches.
float energy_density(ElasticMaterial material, mat3 e, mat3 compression, float lambda) {
    float density = uintBitsToFloat(0x7fc00000u);
    if (is_used(LAW_COROTATIONAL) && material.law == LAW_COROTATIONAL) {
        mat3 even = 0.5 * (e + transpose(e));
        float tr = trace(e);
        density = material.mu * square(even) + 0.5 * lambda * tr * tr;
    } else if (is_used(LAW_NEO_HOOKEAN) && material.law == LAW_NEO_HOOKEAN) {
        density = neo_hookean_energy(e, material.mu, material.lambda);
    }
    return density + penalty_energy(material, compression);
}
