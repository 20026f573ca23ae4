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
//! let mut simulation = Simulation::open(&scene, &Options::default())?;
//! let report = simulation.step()?;
//! println!("{:?}", report.tool.map(|tool| tool.force));
//! # Ok(())
//! # }
//! ```

#![deny(missing_docs)]

mod error;
mod gpu;
mod haptics;
mod plan;
mod prepare;
mod query;
pub mod scene;
mod shaders;
mod stages;
mod step;

pub use error::{Error, Result};
pub use gpu::{Arrays, Context, Options, Threads};
pub use haptics::{Device, Fault, Reading};
pub use query::{Answer, Query, QueryContact, QuerySettings};
pub use scene::{Scene, SceneBuilder};
pub use step::{ContactPoint, Flags, Pose, RigidState, Simulation, StepReport, ToolReport, Wrench};

/// All rooms, for the crates beside this one and for tests. Nothing in here is promised to others.
#[doc(hidden)]
pub mod internal {
    #![allow(missing_docs)]
    pub mod gpu {
        pub use crate::gpu::*;
    }
    pub mod haptics {
        pub use crate::haptics::*;
    }
    pub mod plan {
        pub use crate::plan::*;
    }
    pub mod prepare {
        pub use crate::prepare::*;
    }
    pub mod query {
        pub use crate::query::*;
    }
    pub mod shaders {
        pub use crate::shaders::*;
    }
    pub mod stages {
        pub use crate::stages::*;
    }
    pub mod step {
        pub use crate::step::*;
    }
}
