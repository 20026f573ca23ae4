//! `palpate bench solver`: how the time of a step depends on the displacement error that its linear solver leaves, and
//! how time and memory grow with the size of the mesh. Steps without contact are measured. A setting is a
//! preconditioner with a tolerance. The benchmark has a part for each case (body with a stiffness and a time step), and
//! the part `scaling`, which measures soft cubic blocks with meshes of several sizes.

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
    /// Tolerances of the solver (relative residuals at which it stops).
    pub tolerances: Vec<f64>,
    /// Cap on the solver iterations of a step.
    pub max_iterations: u32,
    /// Greatest number of runs of each case with each setting.
    pub repetitions: usize,
    /// Time budget, s. A case is not run again with a setting if all runs with that setting would together take longer
    /// than this; a block of the part `scaling` does no further steps once this time has passed.
    pub seconds_each: f64,
    /// Numbers of cells along an edge of the blocks of several sizes that the part `scaling` measures.
    pub scaling: Vec<u32>,
    /// Greatest number of measured steps of each block of the part `scaling`.
    pub scaling_steps: usize,
    /// Whether this is the short form of the benchmark (`--quick`).
    pub is_quick: bool,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark, which takes most of an hour, and a quarter of an hour more if the f64 reference solutions
    /// are not yet in the cache.
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

/// The cases of each body, which is given with its number of steps: a soft and a stiff material, each with the short
/// and the long time step.
fn cases(meshes: &[(Mesh, usize)]) -> Vec<Case> {
    let of = |&(mesh, steps): &(Mesh, usize)| {
        YOUNG.into_iter().flat_map(move |young| DT.map(|dt| Case { mesh, young, dt, steps }))
    };
    meshes.iter().flat_map(of).collect()
}

/// Results of the benchmark, without the results of parts that were not measured.
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

/// The benchmark `solver`. Each case is a part of it; the blocks of several sizes together are one more part.
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
