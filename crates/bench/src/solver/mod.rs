//! `palpate bench solver`: what a step costs for the error that it leaves, and how both grow.

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

    /// The smaller bodies, short steps and few samples: for a first look, not for figures.
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

/// What was found.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// Time against error.
    pub cases: Vec<Measured>,
    /// Time and memory against size.
    pub scaling: Vec<Size>,
}

impl Results {
    /// Of the parts that were measured. Errors: they are none of this benchmark.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let cases = parts.iter().filter(|(name, _)| *name != SCALING).map(|(_, case)| from_value(case));
        Ok(Results { cases: cases.collect::<Result<_>>()?, scaling: part(parts, SCALING)? })
    }
}

/// The benchmark: a part for each case, and one for the blocks of several sizes.
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
