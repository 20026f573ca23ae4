//! `palpate bench solver`: what a step costs for the error that it leaves, and how both grow.

mod cases;
mod document;
mod peers;
mod reference;
mod scaling;
mod speed;

use serde::Serialize;

pub use cases::{Case, Mesh, layer, prepared, stiffness};
pub use document::document;
pub use scaling::{Iteration, Size, Steps, exponent};
pub use speed::{Measured, Run};

use crate::Result;
use crate::gpu::{Context, Options};
use crate::scene::Preconditioner;

/// Every preconditioner that the engine knows, and what a scene calls it.
const PRECONDITIONERS: &[(&str, Preconditioner)] =
    &[("jacobi", Preconditioner::Jacobi), ("coarse", Preconditioner::Coarse)];

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Time against error.
    pub cases: Vec<Case>,
    /// Residuals to stop at.
    pub tolerances: Vec<f64>,
    /// Iterations of a step at most.
    pub max_iterations: u32,
    /// Runs of each case with each preconditioner and tolerance, at most.
    pub repetitions: usize,
    /// They are not run again where their steps would take more than this in all, and steps of a size end after it, s.
    pub seconds_each: f64,
    /// Cells an edge of the blocks of several sizes.
    pub scaling: Vec<u32>,
    /// Steps of each of them, at most.
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
            cases: cases(&[(Mesh::Block(12), 50), (Mesh::Block(26), 15), (Mesh::Human, 20)]),
            tolerances: vec![1e-1, 1e-2, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6],
            max_iterations: 2_000,
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
            cases: cases(&[(Mesh::Block(12), 50), (Mesh::Human, 20)]),
            tolerances: vec![1e-2, 1e-3, 3e-4, 1e-4, 1e-5],
            repetitions: 1,
            scaling: vec![12, 18, 26],
            scaling_steps: 3,
            is_quick: true,
            ..Settings::full()
        }
    }

    /// Only what these names call, quick or not; see [`Settings::knows`].
    pub fn only(self, names: &[String]) -> Settings {
        let is_named = |case: &Case| names.iter().any(|name| case.is_called(name));
        let cases = Settings::full().cases.into_iter().filter(is_named).collect();
        let scaling = if names.iter().any(|name| name == SCALING) { self.scaling } else { Vec::new() };
        Settings { cases, scaling, ..self }
    }

    /// Whether anything is called by a name: a body, with its stiffness or that and the time step if wanted, or `scaling`.
    pub fn knows(name: &str) -> bool {
        name == SCALING || Settings::full().cases.iter().any(|case| case.is_called(name))
    }
}

/// Name of the blocks of several sizes.
const SCALING: &str = "scaling";
/// Young's moduli, Pa.
const YOUNG: [f64; 2] = [2e4, 2e6];
/// Time steps, s.
const DT: [f64; 2] = [1e-3, 1e-2];

/// So many steps of each body, soft and stiff, with short steps and long ones.
fn cases(meshes: &[(Mesh, usize)]) -> Vec<Case> {
    let of = |&(mesh, steps): &(Mesh, usize)| {
        YOUNG.into_iter().flat_map(move |young| DT.map(|dt| Case { mesh, young, dt, steps }))
    };
    meshes.iter().flat_map(of).collect()
}

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
    pub cases: Vec<Measured>,
    /// Time and memory against size.
    pub scaling: Vec<Size>,
}

/// Measures everything; `watch` is told what begins. Errors: no device, a device or a reference that fails.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let context = Context::new(&Options { device: settings.device.clone(), ..Options::default() })?;
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
    fn cases_are_asked_for_by_name() {
        let some = Settings::quick().only(&["block105k-20kPa".into(), "human-2MPa-1ms".into()]);
        let names: Vec<String> = some.cases.iter().map(Case::name).collect();
        assert_eq!(names, ["block105k-20kPa-1ms", "block105k-20kPa-10ms", "human-2MPa-1ms"]);
        assert!(some.scaling.is_empty());
        let some = Settings::quick().only(&["scaling".into()]);
        assert!(some.cases.is_empty() && some.scaling == Settings::quick().scaling);
        assert!(Settings::knows("scaling") && Settings::knows("human") && !Settings::knows("hum"));
    }
}
