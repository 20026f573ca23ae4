//! The compression penalty in f64: a stress that keeps a tetrahedron from being pressed flat. Corotational elasticity
//! alone resists pressing a tetrahedron flat hardly more than pressing it to half its height, and lets it turn inside
//! out. Reference implementation of this part of `shaders/shared/material_law.glsl`.

use faer::{Mat, Side};
use glam::{DMat3, DVec3};

use super::elastic::{outer, square, symmetric};

/// Principal stretch below which the compression penalty acts.
pub const LEAST_STRETCH: f64 = 0.3;
/// Greatest modulus of the compression penalty along the compressed axis, in units of lambda + 2 mu.
pub const STIFFENING: f64 = 10.0;
/// Change of stretch below [`LEAST_STRETCH`] over which the penalty's modulus rises from zero.
pub const ONSET: f64 = 0.02;

/// Excess compression, by which principal stretches lie below [`LEAST_STRETCH`]: sum min(0, s_k - [`LEAST_STRETCH`])
/// n_k n_k^T over the principal stretches s_k and principal axes n_k of I + sym(E).
fn excess_compression(strain: DMat3) -> DMat3 {
    let stretch = symmetric(strain);
    // For nearly all tetrahedra Gershgorin's circles show that no stretch is below [`LEAST_STRETCH`], so no eigenvalues
    // are needed.
    let least = |k: usize| {
        let column = stretch.col(k);
        1.0 + column[k] + column[k].abs() - column.abs().element_sum()
    };
    if (0..3).all(|k| least(k) > LEAST_STRETCH) {
        return DMat3::ZERO;
    }
    let matrix = Mat::from_fn(3, 3, |i, j| stretch.col(j)[i]);
    let Ok(eigen) = matrix.self_adjoint_eigen(Side::Lower) else { return DMat3::ZERO };
    let (values, vectors) = (eigen.S(), eigen.U());
    let axis = |k: usize| DVec3::new(vectors[(0, k)], vectors[(1, k)], vectors[(2, k)]);
    (0..3).fold(DMat3::ZERO, |sum, k| sum + outer(axis(k), axis(k)) * (1.0 + values[k] - LEAST_STRETCH).min(0.0))
}

/// The compression penalty at a strain, an isotropic function of the excess compression C. With x = |C|, the energy
/// density has the second derivative STIFFENING (lambda + 2 mu) min(1, x / ONSET) in x.
pub struct Penalty {
    /// Excess compression.
    pub excess: DMat3,
    x: f64,
    greatest_modulus: f64,
}

impl Penalty {
    /// The penalty at a strain of a material with the given mu and lambda, Pa.
    pub fn new((mu, lambda): (f64, f64), strain: DMat3) -> Self {
        let excess = excess_compression(strain);
        Self { excess, x: square(excess).sqrt(), greatest_modulus: STIFFENING * (lambda + 2.0 * mu) }
    }

    /// Share of its greatest modulus that the penalty has.
    pub fn share(&self) -> f64 {
        (self.x / ONSET).min(1.0)
    }

    /// Modulus, Pa, a bound of the penalty's stiffness in every direction.
    pub fn modulus(&self) -> f64 {
        self.share() * self.greatest_modulus
    }

    /// Derivative of the modulus by the excess compression, Pa.
    pub fn modulus_slope(&self) -> f64 {
        if self.x > 0.0 && self.x < ONSET { self.greatest_modulus / ONSET } else { 0.0 }
    }

    /// Stress R^T P, Pa.
    pub fn stress(&self) -> DMat3 {
        let secant = if self.x < ONSET { 0.5 * self.x / ONSET } else { 1.0 - 0.5 * ONSET / self.x };
        self.excess * (secant * self.greatest_modulus)
    }

    /// Energy density, J/m^3.
    pub fn energy(&self) -> f64 {
        let x = self.x;
        let density = if x < ONSET { x.powi(3) / (6.0 * ONSET) } else { 0.5 * x * (x - ONSET) + ONSET * ONSET / 6.0 };
        density * self.greatest_modulus
    }
}
