//! Independent laws that the twins must satisfy. Measured numbers are printed: run with `--nocapture`.

mod contact;
mod elastic;
mod friction;
mod locking;
mod neo_hookean;
mod newton;
mod press;
mod statics;
mod step;

use palpate::scene::{Law, Material};

/// A soft, slightly compressible material; no damping.
pub(crate) fn material(young: f64, poisson: f64) -> Material {
    Material { law: Law::Corotational, young, poisson, density: 1000.0, damping_mass: 0.0, damping_stiffness: 0.0 }
}
