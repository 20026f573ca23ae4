//! The material law in f64: stress, stiffness operator and energy density of a tetrahedron from its strain
//! E = R^T F - I, with rotation R and deformation gradient F. A compression penalty stiffens strongly compressed
//! tetrahedra. Reference implementation of `shaders/shared/material_law.glsl`.

use glam::{DMat3, DVec3};
use palpate::scene::{Material, MaterialLaw};

use super::compression::Penalty;
use super::elastic::{Operator, axial, cross_matrix, lame, positive_part, square, symmetric, trace};
use super::neo_hookean;

/// Stress R^T P, Pa, with the first Piola-Kirchhoff stress P. `lambda` is Lamé's first parameter, Pa, without the part
/// that an F-bar patch (tetrahedra that share one volumetric strain) applies.
pub fn stress(material: &Material, lambda: f64, strain: DMat3) -> DMat3 {
    let of_law = match material.law {
        MaterialLaw::Corotational => Operator::linear(material, lambda).stress(strain),
        MaterialLaw::NeoHookean => neo_hookean::stress(lame(material), strain),
    };
    of_law + Penalty::new(lame(material), strain).stress()
}

/// Stiffness operator at a strain. The shear modulus of a compressed corotational tetrahedron is increased by half the
/// modulus of the compression penalty; this is at least as stiff as the penalty in every direction, and isotropic.
pub fn operator(material: &Material, lambda: f64, strain: DMat3) -> Operator {
    let penalty = Penalty::new(lame(material), strain);
    let linear = Operator::linear(material, lambda);
    let of_law = match material.law {
        MaterialLaw::NeoHookean => neo_hookean::operator(lame(material), strain, &penalty),
        MaterialLaw::Corotational => Operator { mu: linear.mu + 0.5 * penalty.modulus(), ..linear },
    };
    // Where an F-bar patch applies the pressure, the stress here is a part of the whole. A part has no geometric stiffness
    // that would leave rigid rotation free.
    if lambda != lame(material).1 {
        return of_law;
    }
    let geometric = geometric_stiffness(material.law, strain, penalty.excess, stress(material, lambda, strain));
    Operator { geometric: positive_part(geometric), ..of_law }
}

/// Rate R^T dP/dt, Pa/s, at which the stress changes while F changes at the rate R `rate`: the exact derivative of
/// [`stress`], or, where the compression penalty acts or an F-bar patch applies the pressure, the product with the
/// operator; a mean of both, weighted by [`Penalty::share`], where the penalty starts.
pub fn stress_rate(material: &Material, lambda: f64, strain: DMat3, rate: DMat3) -> DMat3 {
    let penalty = Penalty::new(lame(material), strain);
    let operator = operator(material, lambda, strain);
    let with_operator = |geometric: DMat3| {
        let w = rate * operator.fold;
        (operator.stress(w) + cross_matrix(geometric * axial(w)) * 0.5) * operator.fold
    };
    let inexact = if lambda != lame(material).1 { 1.0 } else { penalty.share() };
    let of_operator = with_operator(operator.geometric);
    if inexact == 1.0 {
        return of_operator;
    }
    let exact = match material.law {
        MaterialLaw::NeoHookean => neo_hookean::stress_rate(lame(material), strain, rate),
        MaterialLaw::Corotational => {
            let stress = stress(material, lambda, strain);
            with_operator(geometric_stiffness(material.law, strain, penalty.excess, stress))
        }
    };
    of_operator * inexact + exact * (1.0 - inexact)
}

/// Geometric stiffness Z, Pa, at a strain, with the stress R^T P. The second derivative of the energy of an objective
/// law, for a change dF of F = R S, contains w^T Z w with w the axial vector of the skew part of L. With L = dF F^-1,
/// Z = tr(t) I - t, where t = P F^T is Kirchhoff's stress (turned back by R). With L = dF R^T, as in the corotational
/// operator, an isotropic law has in principal axes Z_k = 2 (s_i + s_j) / (S_i + S_j), with s = R^T P (Smith, de Goes
/// and Kim, "Analytic Eigensystems for Isotropic Distortion Energies", 2019).
fn geometric_stiffness(law: MaterialLaw, strain: DMat3, compression: DMat3, stress: DMat3) -> DMat3 {
    let minus_from_trace = |m: DMat3| DMat3::from_diagonal(DVec3::splat(trace(m))) - m;
    let stretch = DMat3::IDENTITY + symmetric(strain) - compression;
    match law {
        MaterialLaw::NeoHookean => minus_from_trace(symmetric(stress * stretch)),
        MaterialLaw::Corotational => {
            let quotient = minus_from_trace(symmetric(stress)) * minus_from_trace(stretch).inverse();
            symmetric(quotient * 2.0)
        }
    }
}

/// Energy density, J/m^3, zero at rest; `dilatation` is tr(E), or the mean of tr(E) over the F-bar patch.
pub fn energy(material: &Material, strain: DMat3, dilatation: f64) -> f64 {
    let (mu, lambda) = lame(material);
    let of_law = match material.law {
        MaterialLaw::Corotational => mu * square(symmetric(strain)) + 0.5 * lambda * dilatation.powi(2),
        MaterialLaw::NeoHookean => neo_hookean::energy((mu, lambda), strain),
    };
    of_law + Penalty::new((mu, lambda), strain).energy()
}
