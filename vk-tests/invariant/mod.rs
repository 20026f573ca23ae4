//! Tests of invariants, which are laws that whole time steps must keep: momentum, energy, friction, hinges, material
//! laws, continuity of the force.

pub mod continuity;
pub mod energy;
pub mod friction;
pub mod hinges;
pub mod invariants;
pub mod layers;
pub mod materials;
pub mod motion;
pub mod passing;
pub mod stacked;
