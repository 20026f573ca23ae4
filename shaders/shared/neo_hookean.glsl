// Stable neo-Hookean elasticity (Smith, de Goes and Kim 2018, equation 14), a material law of the tetrahedra. The
// equation's parameters are m = 4/3 mu and l = lambda + 5/6 mu, so that mu and lambda are the Lame parameters at small
// strain. F is the deformation gradient, R its polar rotation, e = R^T F - identity the strain, I = |F|^2 and
// J = det F. An including shader includes shared/strain.glsl and defines `Evaluation` and `compression_modulus`. The
// f64 reference is oracle::neo_hookean.

// Factor of the bound from the greatest eigenvalue, so that the operator has at least 0.76 of the true stiffness for
// every wave, at stretches of 0.3 to 2 (sampled; the f64 reference's test). A step needs three quarters: with a true
// stiffness K far above the mass, K in the right-hand side and kappa K in the operator, the step's matrix has the trace
// 2 - 2 / kappa and the determinant 1 - 1 / kappa.
const float STIFFER = 1.9;

mat3 cofactors(mat3 a) {
    return mat3(cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1]));
}

// Evaluates the law at the strain e. The stress is R^T P with P = m (1 - 1 / (I + 1)) F + (l (J - 1) - mu) cof F. It is
// expanded about F = identity, so that at small strain no two nearly equal numbers are subtracted.
//
// The solver's operator is the quadratic form 2 mu' |sym L|^2 + lambda' tr(L)^2 of L = dF F^-1, with dF a change of F.
// Here mu' and lambda' are computed. In terms of L the second derivative of the energy is isotropic except for a matrix
// b = S^2, with S the symmetric factor of F in the polar decomposition. In place of b the operator takes the mean of
// b's eigenvalues; but mu' is at least what an upper bound of b's greatest eigenvalue gives without the pressure term,
// so that the operator is at least 0.76 times as stiff as the second derivative. Principal stretches in S below LEAST
// are raised to LEAST (shared/strain.glsl).
Evaluation neo_hookean(mat3 e, ElasticMaterial material, mat3 compression) {
    float mu = material.mu, lambda = material.lambda;
    float m = 4.0 / 3.0 * mu, l = lambda + 5.0 / 6.0 * mu, tr = trace(e);
    mat3 co = cofactors(e);
    float grown = 2.0 * tr + square(e);     // I - 3
    float larger = tr + 0.5 * (tr * tr - trace(e * e)) + determinant(e);        // J - 1
    mat3 all_cofactors = mat3(1.0 + tr) - transpose(e) + co;
    Evaluation law;
    law.stress = mu * (e + transpose(e) - mat3(tr) - co) + (mu / 3.0 * grown / (4.0 + grown)) * (mat3(1.0) + e)
        + (l * larger) * all_cofactors;

    mat3 s = mat3(1.0) + 0.5 * (e + transpose(e)) - compression, b = s * s;
    float volume = determinant(s), pressure = l * larger - mu, c = m * (3.0 + grown) / (4.0 + grown);
    float mean = trace(b) / 3.0;
    float greatest = mean + sqrt(2.0 / 3.0 * square(b - mat3(mean)));
    float share = mean / (4.0 + grown);
    law.mu = 0.5 * max(c * mean - pressure * volume, STIFFER * c * greatest);
    law.mu += 0.5 * LEAST * LEAST * compression_modulus(material, compression);
    law.lambda = max(0.0, volume * (l * volume + pressure) + 2.0 * m * share * share);
    law.fold = inverse(s);
    return law;
}

// Inner product of two matrices.
float inner(mat3 a, mat3 b) {
    return dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2]);
}

// Rate R^T dP/dt (Pa/s) of the stress while F changes at the rate R `rate`: with f = identity + e and p = l (J - 1) -
// mu, m (1 - 1 / (I + 1)) rate + 2 m (f : rate) / (I + 1)^2 f + p d(cof f)/dt + l (cof f : rate) cof f.
mat3 neo_hookean_rate(mat3 e, ElasticMaterial material, mat3 rate) {
    float m = 4.0 / 3.0 * material.mu, l = material.lambda + 5.0 / 6.0 * material.mu, tr = trace(e);
    float grown = 2.0 * tr + square(e), larger = tr + 0.5 * (tr * tr - trace(e * e)) + determinant(e);
    mat3 f = mat3(1.0) + e, all_cofactors = cofactors(f);
    mat3 turned = mat3(cross(rate[1], f[2]) + cross(f[1], rate[2]), cross(rate[2], f[0]) + cross(f[2], rate[0]),
        cross(rate[0], f[1]) + cross(f[0], rate[1]));
    return m * (3.0 + grown) / (4.0 + grown) * rate + 2.0 * m * inner(f, rate) / ((4.0 + grown) * (4.0 + grown)) * f
        + (l * larger - material.mu) * turned + l * inner(all_cofactors, rate) * all_cofactors;
}

// Energy density (J/m^3), zero at rest, also expanded about F = identity: with x = (I - 3) / 4, the density is
// m/2 (3/4 (|e|^2 + tr(e e) - tr(e)^2) - 3/2 det e + x - log(1 + x)) + l/2 (J - 1)^2.
float neo_hookean_energy(mat3 e, float mu, float lambda) {
    float m = 4.0 / 3.0 * mu, l = lambda + 5.0 / 6.0 * mu, tr = trace(e), second = trace(e * e), third = determinant(e);
    float x = 0.25 * (2.0 * tr + square(e)), larger = tr + 0.5 * (tr * tr - second) + third;
    float bent = x - log(1.0 + x);
    if (abs(x) < 0.1) bent = x * x * (1.0 / 2.0 - x * (1.0 / 3.0 - x * (1.0 / 4.0 - x * (1.0 / 5.0 - x * (1.0 / 6.0 - x / 7.0)))));
    return 0.5 * (m * (0.75 * (square(e) + second - tr * tr) - 1.5 * third + bent) + l * larger * larger);
}
