//! The material law in f64: stress, stiffness operator and energy density of a tetrahedron from its strain
//! E = R^T F - I, with rotation R and deformation gradient F. A compression penalty stiffens strongly compressed
//! tetrahedra. Reference implementation of `shaders/shared/material_law.glsl`.

use glam::DMat3;
use palpate::scene::{Material, MaterialLaw};

use super::elastic::{Operator, excess_compression, lame, stiffening, symmetric};
use super::neo_hookean;

/// Stress R^T P, Pa, with the first Piola-Kirchhoff stress P. `lambda` is Lamé's first parameter, Pa, without the part
/// that an F-bar patch (tetrahedra that share one volumetric strain) applies.
pub fn stress(material: &Material, lambda: f64, strain: DMat3) -> DMat3 {
    let of_law = match material.law {
        MaterialLaw::Corotational => Operator::linear(material, lambda).stress(strain),
        MaterialLaw::NeoHookean => neo_hookean::stress(lame(material), strain),
    };
    of_law + excess_compression(strain) * stiffening(lame(material))
}

/// Stiffness operator at a strain. The shear modulus of a compressed corotational tetrahedron is increased by half the
/// modulus of the compression penalty; this is at least as stiff as the penalty in every direction, and isotropic.
pub fn operator(material: &Material, lambda: f64, strain: DMat3) -> Operator {
    let compression = excess_compression(strain);
    let linear = Operator::linear(material, lambda);
    match material.law {
        MaterialLaw::NeoHookean => neo_hookean::operator(lame(material), strain, compression),
        MaterialLaw::Corotational if compression == DMat3::ZERO => linear,
        MaterialLaw::Corotational => Operator { mu: linear.mu + 0.5 * stiffening(lame(material)), ..linear },
    }
}

/// Energy density, J/m^3, zero at rest; `dilatation` is tr(E), or the mean of tr(E) over the F-bar patch.
pub fn energy(material: &Material, strain: DMat3, dilatation: f64) -> f64 {
    let (mu, lambda) = lame(material);
    let square = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>();
    let of_law = match material.law {
        MaterialLaw::Corotational => mu * square(symmetric(strain)) + 0.5 * lambda * dilatation.powi(2),
        MaterialLaw::NeoHookean => neo_hookean::energy((mu, lambda), strain),
    };
    of_law + 0.5 * stiffening((mu, lambda)) * square(excess_compression(strain))
}
