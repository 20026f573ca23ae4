//! Tests that run whole scenes as a user does, by simulation steps or in the haptic loop. Results are compared with the
//! f64 oracle (the reference implementation on the CPU) or with properties that they must have.

pub mod adversaries;
pub mod agreement;
mod arrays;
pub mod bones;
pub mod change;
pub mod deep_press;
pub mod dirty_meshes;
pub mod explain;
pub mod extremes;
pub mod haptics;
pub mod heads;
pub mod held;
pub mod joints;
pub mod judge;
mod loads;
mod pressures;
pub mod query;
pub mod replay;
pub mod saved;
pub mod shipped;
pub mod spheres;
mod supports;
mod tools;
pub mod touch;
pub mod whole_step;
