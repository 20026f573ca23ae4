//! The stable neo-Hookean law of one tetrahedron in f64.
//!
//! Smith, de Goes and Kim, "Stable Neo-Hookean Flesh Simulation" (2018), equation 14: energy density
//! m/2 (I - 3) + l/2 (J - a)^2 - m/2 log(I + 1), with I = tr(F^T F), J = det F, a = 1 + 3 m / (4 l) and the deformation
//! gradient F. At small strain it is Hooke's law with Lamé's parameters mu and lambda where m = 4/3 mu and
//! l = lambda + 5/6 mu (section 3.4 of that paper).

use glam::{DMat3, DVec3};

use super::compression::{LEAST_STRETCH, Penalty};
use super::elastic::{Operator, square, symmetric, trace};

/// Factor of the bound from b's greatest eigenvalue in [`operator`]. With it the operator has at least 0.76 of the true
/// stiffness for every wave, at stretches of 0.3 to 2 (sampled).
const STIFFER: f64 = 1.9;

/// The matrix of cofactors.
fn cofactors(m: DMat3) -> DMat3 {
    let [a, b, c] = [m.x_axis, m.y_axis, m.z_axis];
    DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b))
}

/// The parameters m and l of a material, Pa, from mu and lambda.
fn parameters((mu, lambda): (f64, f64)) -> (f64, f64) {
    (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu)
}

/// Energy density, J/m^3, zero at rest; `lame`: mu and lambda, Pa; `strain`: R^T F - I with any rotation R.
pub fn energy(lame: (f64, f64), strain: DMat3) -> f64 {
    let (m, l) = parameters(lame);
    let f = DMat3::IDENTITY + strain;
    let a = 1.0 + 0.75 * m / l;
    let density = |square: f64, j: f64| 0.5 * (m * (square - 3.0 - (square + 1.0).ln()) + l * (j - a) * (j - a));
    density(square(f), f.determinant()) - density(3.0, 1.0)
}

/// First Piola-Kirchhoff stress P as R^T P, Pa, computed without cancellation at small strain.
pub fn stress(lame: (f64, f64), strain: DMat3) -> DMat3 {
    let (mu, _) = lame;
    let (_, l) = parameters(lame);
    let (e, tr) = (strain, trace(strain));
    let (cofactors, more) = (cofactors(e), 2.0 * tr + square(e));
    let volume = tr + 0.5 * (tr * tr - trace(e * e)) + e.determinant();
    let all_cofactors = DMat3::from_diagonal(DVec3::splat(1.0 + tr)) - e.transpose() + cofactors;
    (e + e.transpose() - DMat3::from_diagonal(DVec3::splat(tr)) - cofactors) * mu
        + (DMat3::IDENTITY + e) * (mu / 3.0 * more / (4.0 + more))
        + all_cofactors * (l * volume)
}

/// Rate R^T dP/dt, Pa/s, at which the stress changes while F changes at the rate R `rate`: the derivative of [`stress`].
pub fn stress_rate(lame: (f64, f64), strain: DMat3, rate: DMat3) -> DMat3 {
    let (mu, _) = lame;
    let (m, l) = parameters(lame);
    let f = DMat3::IDENTITY + strain;
    let inner = |a: DMat3, b: DMat3| trace(a.transpose() * b);
    let (more, cofactors_now) = (square(f) + 1.0, cofactors(f));
    // Cofactors are quadratic in F, so this central difference is exact.
    let turned = (cofactors(f + rate) - cofactors(f - rate)) * 0.5;
    rate * (m * (1.0 - 1.0 / more))
        + f * (2.0 * m * inner(f, rate) / (more * more))
        + turned * (l * (f.determinant() - 1.0) - mu)
        + cofactors_now * (l * inner(cofactors_now, rate))
}

/// The stiffness operator at a strain. Symbols: the rotation R and stretch S in F = R S, p = l (J - 1) - mu, b = S^2,
/// c = m (1 - 1 / (I + 1)), and L = R^T dF S^-1 for a change dF of F, with the symmetric part D and skew part O of L.
/// The second derivative of the energy is
/// c tr(L b L^T) - p J (|D|^2 - |O|^2) + J (l J + p) tr(D)^2 + 2 m (b:D)^2 / (I + 1)^2, which is isotropic except for
/// b. The operator must be isotropic. So its doubled shear modulus is the greater of two numbers: c times the mean
/// eigenvalue of b, minus p J; and `STIFFER` c times an upper bound of the greatest eigenvalue of b. This is enough,
/// because a step whose right-hand side has the exact rate of the force is stable if its operator has at least three
/// quarters of the true stiffness for every wave. O, a pure rotation, is left to the
/// geometric stiffness (`material_law.rs`), which is zero here.
/// Subtracting the excess compression keeps S from being singular.
pub fn operator(lame: (f64, f64), strain: DMat3, penalty: &Penalty) -> Operator {
    let (mu, _) = lame;
    let (m, l) = parameters(lame);
    let f = DMat3::IDENTITY + strain;
    let stretch = symmetric(f) - penalty.excess;
    let (invariant, volume) = (square(f), stretch.determinant());
    let pressure = l * (f.determinant() - 1.0) - mu;
    let c = m * (1.0 - 1.0 / (invariant + 1.0));
    let b = stretch * stretch;
    let mean = trace(b) / 3.0;
    let spread = square(b - DMat3::from_diagonal(DVec3::splat(mean)));
    let greatest = mean + (2.0 / 3.0 * spread).sqrt();
    let more = 0.5 * LEAST_STRETCH * LEAST_STRETCH * penalty.modulus();
    let rank_one = 2.0 * m * (mean / (invariant + 1.0)).powi(2);
    Operator {
        mu: 0.5 * (c * mean - pressure * volume).max(STIFFER * c * greatest) + more,
        lambda: (volume * (l * volume + pressure) + rank_one).max(0.0),
        fold: stretch.inverse(),
        geometric: DMat3::ZERO,
    }
}
