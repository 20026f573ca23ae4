//! Tests of what the f64 reference implementations must satisfy however they are written: conservation laws, solutions
//! in closed form, orders of convergence. Tests print what they measure; run them with `--nocapture`.

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

/// An undamped corotational material of density 1000 kg/m^3, with Young's modulus (Pa) and Poisson's ratio.
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
