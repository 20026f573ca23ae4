//! palpate: feel soft bodies.
//!
//! The map of the house: [`scene`] is what a user writes, [`prepare`] makes layered bodies of it, [`stages`] are the
//! kernels of the step and [`step`] their order, [`query`] is the proximity query by itself, [`gpu`] is the only room that
//! speaks Vulkan, [`oracle`] holds the f64 twins that tests compare with, [`report`] writes results, [`bench`]
//! measures.

pub mod error;
pub mod gpu;
pub mod haptics;
pub mod plan;
pub mod prepare;
pub mod query;
pub mod scene;
pub mod stages;
pub mod step;

pub use error::{Error, Result};
