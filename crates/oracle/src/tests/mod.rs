//! Invariants that the f64 reference implementations must satisfy, independent of how they are written: conservation,
//! closed solutions, convergence. Tests print what they measure: run with `--nocapture`.

mod contact;
mod elastic;
mod friction;
mod locking;
mod neo_hookean;
mod newton;
mod press;
mod statics;
mod step;

use palpate::scene::{Material, MaterialLaw};

/// A corotational material of density 1000 kg/m^3 without damping.
pub(crate) fn material(young: f64, poisson: f64) -> Material {
    Material {
        law: MaterialLaw::Corotational,
        young,
        poisson,
        density: 1000.0,
        damping_mass: 0.0,
        damping_stiffness: 0.0,
    }
}
