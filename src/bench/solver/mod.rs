//! `palpate bench solver`: what a step costs for the error that it leaves, and how both grow.

mod cases;
mod document;
mod peers;
mod reference;
mod scaling;
mod speed;

use serde::Serialize;

pub use cases::Mesh;
pub use document::document;
pub use scaling::{Iteration, Size, Steps};
pub use speed::{Case, Run};

use crate::Result;
use crate::gpu::{Context, Options};
use crate::scene::Preconditioner;

/// Every preconditioner that the engine knows, and what a scene calls it.
const PRECONDITIONERS: &[(&str, Preconditioner)] = &[("jacobi", Preconditioner::Jacobi)];

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Bodies, and how many steps of each.
    pub meshes: Vec<(Mesh, usize)>,
    /// Young's moduli, Pa.
    pub young: Vec<f64>,
    /// Time steps, s.
    pub dt: Vec<f64>,
    /// Residuals to stop at.
    pub tolerances: Vec<f64>,
    /// Iterations of a step at most.
    pub max_iterations: u32,
    /// Runs of each case with each preconditioner and tolerance, at most.
    pub repetitions: usize,
    /// They are not run again where their steps would take more than this in all, s.
    pub seconds_each: f64,
    /// Cells an edge of the blocks of several sizes.
    pub scaling: Vec<u32>,
    /// Steps of each of them.
    pub scaling_steps: usize,
    /// Whether this is a short form of the whole.
    pub is_quick: bool,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
}

impl Settings {
    /// All of it: the better part of an hour, and a quarter more where references are not cached yet.
    pub fn full() -> Settings {
        Settings {
            meshes: vec![(Mesh::Block(12), 50), (Mesh::Block(26), 15), (Mesh::Human, 20)],
            young: vec![2e4, 2e6],
            dt: vec![1e-3, 1e-2],
            tolerances: vec![1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6],
            max_iterations: 3_000,
            repetitions: 3,
            seconds_each: 60.0,
            scaling: vec![12, 18, 26, 38, 55],
            scaling_steps: 5,
            is_quick: false,
            device: None,
        }
    }

    /// The smaller bodies, and few samples: for a first look, not for figures.
    pub fn quick() -> Settings {
        Settings {
            meshes: vec![(Mesh::Block(12), 50), (Mesh::Human, 20)],
            tolerances: vec![1e-2, 1e-3, 1e-4, 1e-5],
            repetitions: 1,
            scaling: vec![12, 18, 26],
            scaling_steps: 3,
            is_quick: true,
            ..Settings::full()
        }
    }

    /// The cases of these names and no others, quick or not.
    pub fn only(self, names: &[String]) -> Settings {
        let is_named = |name: &str| names.iter().any(|asked| asked == name);
        let meshes = Settings::full().meshes.into_iter().filter(|(mesh, _)| is_named(&mesh.name())).collect();
        let scaling = if is_named(SCALING) { self.scaling } else { Vec::new() };
        Settings { meshes, scaling, ..self }
    }
}

/// What [`Settings::only`] may name: the bodies of [`Settings::full`], and [`SCALING`].
pub const NAMES: [&str; 4] = ["block10k", "block105k", "human", SCALING];
/// Name of the blocks of several sizes among the cases.
const SCALING: &str = "scaling";

/// The contents of `results.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// [`super::SCHEMA`].
    pub schema: u32,
    /// Always `solver`.
    pub benchmark: &'static str,
    /// Version of palpate.
    pub version: &'static str,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Threads that this machine runs at once.
    pub threads: usize,
    /// What was asked for.
    pub settings: Settings,
    /// Time against error.
    pub cases: Vec<Case>,
    /// Time and memory against size.
    pub scaling: Vec<Size>,
}

/// Measures everything; `watch` is told what begins. Errors: no device, a device or a reference that fails.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let context = Context::new(&Options { device: settings.device.clone(), validation: false })?;
    let (device, driver) = (context.device_name().into(), context.driver().into());
    drop(context);
    let cases = speed::measure(settings, watch)?;
    let scaling = scaling::measure(settings, watch)?;
    Ok(Results {
        schema: super::SCHEMA,
        benchmark: "solver",
        version: env!("CARGO_PKG_VERSION"),
        device,
        driver,
        threads: std::thread::available_parallelism().map_or(1, Into::into),
        settings: settings.clone(),
        cases,
        scaling,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_have_names() {
        let full = Settings::full();
        let names: Vec<String> = full.meshes.iter().map(|(mesh, _)| mesh.name()).chain([SCALING.into()]).collect();
        assert_eq!(names, NAMES);
        let some = Settings::quick().only(&["block105k".into()]);
        assert!(some.meshes == [(Mesh::Block(26), 15)] && some.scaling.is_empty());
        let some = Settings::quick().only(&["scaling".into()]);
        assert!(some.meshes.is_empty() && some.scaling == Settings::quick().scaling);
    }
}
