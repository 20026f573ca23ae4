//! palpate: a GPU engine for haptic touch of soft bodies. A haptic device moves a rigid tool. The engine finds, in
//! Vulkan compute, where the tool meets the high-resolution surface mesh (skin) of a deformable body, deforms the body
//! by finite elements, and returns the contact force and torque on the tool.
//!
//! A [`Scene`] is read from a file ([`Scene::load`]) or built in memory ([`SceneBuilder`], [`scene`]). A [`Simulation`]
//! advances a scene step by step; a [`Query`] only finds where the skins of two rigid bodies overlap. Quaternions are
//! in the order x y z w, units are SI, axes are right-handed.
//!
//! This example presses a sphere 6 mm into a soft block:
//!
//! ```
//! use palpate::scene::{Bind, Body, Core, Coupling, Key, Material, Tool};
//! use palpate::{Flags, Options, SceneBuilder, Simulation};
//!
//! # fn main() -> palpate::Result<()> {
//! let mut block = Body::block("block", [-0.03, -0.03, -0.03], [0.03, 0.0, 0.03], [8, 4, 8], Material::new(2e4, 0.45, 1000.0));
//! block.cores.push(Core::fixed("table", Bind::Box { low: [-1.0, -1.0, -1.0].into(), high: [1.0, -0.029, 1.0].into() }));
//! let scene = SceneBuilder::new("press")
//!     .body(block)?
//!     .tool(Tool::sphere(0.01, 0.05).at([0.0, 0.011, 0.0]))?
//!     .coupling(Coupling { stiffness: 1000.0, damping: 10.0, ..Coupling::default() })?
//!     .trajectory(vec![Key::at(0.0, [0.0, 0.011, 0.0]), Key::at(0.1, [0.0, 0.004, 0.0])])?
//!     .build()?;
//! let mut simulation = Simulation::open(&scene, &Options::default())?;
//! for _ in 0..120 {
//!     let report = simulation.step()?;
//!     assert_eq!(report.flags, Flags::default());
//! }
//! let felt = simulation.step()?.tool.expect("the scene has a tool");
//! println!("{:.2} N upwards", felt.force.y);
//! # assert!(felt.force.y > 0.1 && felt.force.y < 10.0, "{}", felt.force);
//! # Ok(())
//! # }
//! ```
//!
//! More examples are in `examples/rust`. Haptic devices, rendering, benchmarks, the C ABI and the command-line program
//! are crates of their own.

#![deny(missing_docs)]

mod error;
mod files;
mod gpu;
mod haptics;
mod memory;
mod plan;
mod prepare;
mod query;
pub mod scene;
mod shaders;
mod stages;
mod step;

pub use error::{Error, Result};
pub use gpu::{Arrays, Context, Options, Threads};
pub use query::{Answer, Query, QueryContact};
pub use scene::{Scene, SceneBuilder};
#[doc(hidden)]
pub use step::RigidState;
pub use step::{ContactPoint, Explanation, Flags, Pose, Simulation, StepReport, StepWork, ToolReport, Wrench};

/// All modules, for the other crates of this workspace and for tests. Nothing in here is part of the stable interface.
#[doc(hidden)]
pub mod internal {
    #![allow(missing_docs)]
    pub use crate::error::printable;
    pub mod files {
        pub use crate::files::*;
    }
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

/// The Rust code of README.md, compiled and run with the examples of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;

/// The Rust code of docs/reference/rust.md (the reference page on the Rust interface), compiled and run with the
/// examples of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../docs/reference/rust.md")]
pub struct RustPage;
