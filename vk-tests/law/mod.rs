//! Laws that whole steps keep: momentum, energy, friction, incompressibility, invariance.

pub mod continuity;
pub mod energy;
pub mod friction;
pub mod hinges;
pub mod invariants;
pub mod layers;
pub mod materials;
pub mod motion;
