//! The material law in f64: stress, operator and energy density of a tetrahedron from its strain R^T F - I, with the
//! compression penalty. Twin of `shaders/shared/material_law.glsl`.

use glam::DMat3;
use palpate::scene::{Law, Material};

use super::elastic::{Operator, lame, squeeze, stiffening, symmetric};
use super::neo_hookean;

/// R^T P, Pa; `lambda`: what of it the tetrahedron has for itself, Pa, the rest acts by its patch.
pub fn stress(material: &Material, lambda: f64, strain: DMat3) -> DMat3 {
    let of_law = match material.law {
        Law::Corotational => Operator::linear(material, lambda).stress(strain),
        Law::NeoHookean => neo_hookean::stress(lame(material), strain),
    };
    of_law + squeeze(strain) * stiffening(lame(material))
}

/// What K is made of. A corotational tetrahedron that is squeezed gets half the compression penalty more shear modulus, which
/// is at least as stiff in every direction as the penalty, and isotropic.
pub fn operator(material: &Material, lambda: f64, strain: DMat3) -> Operator {
    let squeezed = squeeze(strain);
    let linear = Operator::linear(material, lambda);
    match material.law {
        Law::NeoHookean => neo_hookean::operator(lame(material), strain, squeezed),
        Law::Corotational if squeezed == DMat3::ZERO => linear,
        Law::Corotational => Operator { mu: linear.mu + 0.5 * stiffening(lame(material)), ..linear },
    }
}

/// Energy density, J/m^3, zero at rest; `dilatation`: tr(E), or its patch's mean.
pub fn energy(material: &Material, strain: DMat3, dilatation: f64) -> f64 {
    let (mu, lambda) = lame(material);
    let square = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>();
    let of_law = match material.law {
        Law::Corotational => mu * square(symmetric(strain)) + 0.5 * lambda * dilatation.powi(2),
        Law::NeoHookean => neo_hookean::energy((mu, lambda), strain),
    };
    of_law + 0.5 * stiffening((mu, lambda)) * square(squeeze(strain))
}
