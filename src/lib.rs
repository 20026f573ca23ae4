//! palpate: feel soft bodies.
//!
//! The rooms, each importing only those after it: [`haptics`] is the loop that the hand feels, [`step`] a step of the simulation,
//! [`query`] the proximity query by itself, [`plan`] what a scene needs, [`stages`] the kernels, [`prepare`] layered bodies,
//! [`scene`] what a user writes, [`shaders`] what shaders and host share, [`gpu`] the only room that speaks Vulkan. Devices,
//! pictures, benchmarks, the C ABI and the program are crates of their own.
//!
//! ```no_run
//! use palpate::gpu::Options;
//! use palpate::scene::Scene;
//! use palpate::step::Simulation;
//!
//! # fn main() -> palpate::Result<()> {
//! let scene = Scene::load("assets/scenes/touch-head.toml".as_ref())?;
//! let mut simulation = Simulation::new(&scene, &Options::default(), None)?;
//! let report = simulation.step()?;
//! println!("{:?}", report.tool.map(|tool| tool.force));
//! # Ok(())
//! # }
//! ```

pub mod error;
pub mod gpu;
pub mod haptics;
pub mod plan;
pub mod prepare;
pub mod query;
pub mod scene;
pub mod shaders;
pub mod stages;
pub mod step;

pub use error::{Error, Result};
