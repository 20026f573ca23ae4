//! Whole steps and sessions as a user runs them, compared with the f64 oracle or with properties that the results must
//! have.

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
mod pressures;
pub mod query;
pub mod replay;
pub mod saved;
pub mod shipped;
pub mod spheres;
pub mod touch;
pub mod whole_step;
