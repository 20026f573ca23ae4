//! `palpate validate`: the engine against values that others published. A case is a problem with a known answer; its
//! quantities are computed on ever finer meshes, and the published value must lie where refinement leads (`series`).
//!
//! `cases` has the problems, `lab` runs them, and `document` writes the report.

pub mod cases;
mod document;
mod lab;
mod meshes;
pub mod series;

use std::time::Instant;

use palpate::{Error, Result};
use serde::Serialize;

pub use document::document;

use cases::Case;
use lab::Lab;
use series::{Quantity, Verdict};

/// Version of the format of `results.json`: raised when a field changes its meaning or is removed.
pub const SCHEMA: u32 = 1;

/// Which cases are run, and how.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Settings {
    /// Whether fewer and coarser meshes are used (`--quick`).
    pub is_quick: bool,
    /// Names of the cases to run; empty: all of them.
    pub only: Vec<String>,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
    /// Shaders to replace, for tests that plant faults: see [`palpate::Options::replaced`].
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

impl Settings {
    /// The cases to run.
    pub fn cases(&self) -> impl Iterator<Item = &'static Case> {
        let is_asked = |case: &&Case| self.only.is_empty() || self.only.iter().any(|name| name == case.name);
        cases::ALL.iter().filter(is_asked)
    }
}

/// A quantity with its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// The published value, and the levels.
    pub quantity: Quantity,
    /// What the levels say.
    pub verdict: Verdict,
}

/// A case that was run.
#[derive(Debug, Clone, Serialize)]
pub struct CaseResult {
    /// The case, by its name.
    #[serde(rename = "name", serialize_with = "name")]
    pub case: &'static Case,
    /// Its quantities.
    pub quantities: Vec<Judged>,
    /// Why the case could not be run to its end; `None`: it was.
    pub failure: Option<String>,
    /// Wall time, s.
    pub seconds: f64,
}

fn name<S: serde::Serializer>(case: &&'static Case, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.serialize_str(case.name)
}

/// Results of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Version of the format of these results.
    pub schema: u32,
    /// Version of palpate.
    pub version: &'static str,
    /// The git commit that palpate was built from, with `-changed` if the sources differed from it; `unknown` outside a
    /// repository.
    pub commit: &'static str,
    /// Name of the GPU device.
    pub device: String,
    /// Name and version of the GPU driver.
    pub driver: String,
    /// Number of hardware threads of the machine.
    pub threads: usize,
    /// What was run.
    pub settings: Settings,
    /// The cases.
    pub cases: Vec<CaseResult>,
    /// Wall time of the run, s.
    pub seconds: f64,
}

impl Results {
    /// What is not reproduced, a line for each.
    pub fn faults(&self) -> Vec<String> {
        let of_case = |case: &CaseResult| {
            let off = case.quantities.iter().filter(|judged| !judged.verdict.is_reproduced).map(|judged| {
                let Judged { quantity, verdict } = judged;
                let name = format!("{}, {}", case.case.name, quantity.name);
                match quantity.levels.iter().find(|level| !level.flags.is_empty()) {
                    Some(level) => format!("{name}: {} raised {}", level.label, level.flags.join(", ")),
                    None => format!(
                        "{name}: {} where {} is expected, off by {} with a bound of {}",
                        document::number(verdict.limit),
                        document::number(verdict.expected),
                        document::share(verdict.error),
                        document::share(verdict.bound)
                    ),
                }
            });
            let failure = case.failure.iter().map(|failure| format!("{}: {failure}", case.case.name));
            off.chain(failure).collect::<Vec<_>>()
        };
        self.cases.iter().flat_map(of_case).collect()
    }
}

/// Runs the cases; `watch` is told what is run. Errors: the device or a mesh's file fails; a case that fails
/// otherwise is among the faults.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let begun = Instant::now();
    let mut lab = Lab::new(settings, watch)?;
    let (device, driver) = (lab.context().device_name().to_string(), lab.context().driver().to_string());
    let mut results = Vec::new();
    for case in settings.cases() {
        let begun = Instant::now();
        let (quantities, failure) = match lab.measure(case) {
            Ok(quantities) => (quantities, None),
            Err(Error::Simulation(failure)) => (Vec::new(), Some(failure)),
            Err(error) => return Err(error),
        };
        let judged = |quantity: Quantity| Judged { verdict: quantity.verdict(), quantity };
        let quantities = quantities.into_iter().map(judged).collect();
        results.push(CaseResult { case, quantities, failure, seconds: begun.elapsed().as_secs_f64() });
    }
    Ok(Results {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        commit: env!("PALPATE_COMMIT"),
        device,
        driver,
        threads: std::thread::available_parallelism().map_or(1, Into::into),
        settings: settings.clone(),
        cases: results,
        seconds: begun.elapsed().as_secs_f64(),
    })
}
