//! `palpate bench solver`: the time of a step for the error that its linear solver leaves, and how time and memory grow
//! with the size of the mesh. A step without contact is measured.

mod cases;
mod document;
mod peers;
mod reference;
mod scaling;
mod speed;

use serde::Serialize;
use serde_json::{Map, Value};

pub use cases::{Case, Mesh, layer, prepared, stiffness};
pub use scaling::{Iteration, Size, Steps};
pub use speed::{Measured, Run};

use palpate::Result;
use palpate::scene::Preconditioner;

use super::suite::{from_value, part, to_value};
use super::{Benchmark, Section};

/// Every preconditioner of the engine, with its name in a scene file.
const PRECONDITIONERS: &[(&str, Preconditioner)] =
    &[("jacobi", Preconditioner::Jacobi), ("coarse", Preconditioner::Coarse)];

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Cases (body, stiffness and time step) whose time and error are measured.
    pub cases: Vec<Case>,
    /// Solver tolerances (relative residuals at which to stop).
    pub tolerances: Vec<f64>,
    /// Cap on the solver iterations of a step.
    pub max_iterations: u32,
    /// Most runs of each case with each preconditioner and tolerance.
    pub repetitions: usize,
    /// Time budget, s: a setting is not run again if all its runs would take longer, and blocks of the part `scaling`
    /// do no further steps once this time has passed.
    pub seconds_each: f64,
    /// Cells along an edge of the blocks of several sizes (part `scaling`).
    pub scaling: Vec<u32>,
    /// Most steps of each block of the part `scaling`.
    pub scaling_steps: usize,
    /// Whether this is the short form of the benchmark (`--quick`).
    pub is_quick: bool,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark: most of an hour, and a quarter of an hour more if no f64 references are cached yet.
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

    /// A short form with the smaller bodies, short time steps and few samples, for a first look; not for figures to
    /// quote.
    pub fn quick() -> Settings {
        let mut cases = cases(&[(Mesh::Block(12), 25), (Mesh::Human, 10)]);
        cases.retain(|case| case.dt == DT[0]);
        Settings {
            cases,
            repetitions: 1,
            scaling: vec![6, 8, 10, 12, 15, 18],
            scaling_steps: 3,
            is_quick: true,
            ..Settings::full()
        }
    }
}

/// Name of the part that measures blocks of several sizes.
const SCALING: &str = "scaling";
/// Young's moduli, Pa.
const YOUNG: [f64; 2] = [2e4, 2e6];
/// Time steps, s.
const DT: [f64; 2] = [1e-3, 1e-2];

/// Cases of each body with its number of steps: soft and stiff, each with the short and the long time step.
fn cases(meshes: &[(Mesh, usize)]) -> Vec<Case> {
    let of = |&(mesh, steps): &(Mesh, usize)| {
        YOUNG.into_iter().flat_map(move |young| DT.map(|dt| Case { mesh, young, dt, steps }))
    };
    meshes.iter().flat_map(of).collect()
}

/// Results of the benchmark; the results of parts that were not measured are missing.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// Time and error of each case.
    pub cases: Vec<Measured>,
    /// Time and memory of blocks of several sizes.
    pub scaling: Vec<Size>,
}

impl Results {
    /// Reads the results of the parts that were measured. Errors: a part does not have the form of this benchmark's
    /// results.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let cases = parts.iter().filter(|(name, _)| *name != SCALING).map(|(_, case)| from_value(case));
        Ok(Results { cases: cases.collect::<Result<_>>()?, scaling: part(parts, SCALING)? })
    }
}

/// The benchmark `solver`; each case is a part of it, and the blocks of several sizes are one part.
pub struct Solver(pub Settings);

impl Benchmark for Solver {
    fn name(&self) -> &'static str {
        "solver"
    }

    fn title(&self) -> &'static str {
        "What a step costs"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        let scaling = if self.0.scaling.is_empty() { None } else { Some(SCALING.into()) };
        self.0.cases.iter().map(Case::name).chain(scaling).collect()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        match self.0.cases.iter().find(|case| case.name() == part) {
            Some(case) => to_value(&speed::measure(case, &self.0, watch)?),
            None => to_value(&scaling::measure(&self.0, watch)?),
        }
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(document::preface(settings))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&Results::of(parts)?)
    }
}
