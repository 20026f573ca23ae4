//! `palpate stability`: a matrix of stiff and extreme cases, each with a verdict from laws and not from eyesight.
//!
//! `axes` says what is varied, `cases` what is done with the block and what must come of it, `setup` makes the scene, `trace`
//! measures each step from outside in f64, `laws` judges the measured steps, and `document` reports.

pub mod axes;
pub mod cases;
pub mod document;
mod equations;
mod heat_map;
mod labels;
pub mod laws;
mod meshes;
mod modes;
mod reasons;
mod run;
pub mod setup;
mod touch;
pub mod trace;

use serde::Serialize;

pub use document::document;
pub use run::run;

use palpate::Flags;

use laws::{Finding, Verdict};

/// Version of the format of `results.json`: raised when a field changes its meaning or goes.
pub const SCHEMA: u32 = 2;

/// What is run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Settings {
    /// Fewer values and steps.
    pub is_quick: bool,
    /// A million steps of resting contact.
    pub is_soak: bool,
    /// These axes alone; empty: all.
    pub only: Vec<String>,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
    /// See `replaced` of the options that a device is opened with.
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

/// A simulation and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// Which of its cell.
    pub scenario: String,
    /// What became of it.
    pub verdict: Verdict,
    /// Steps done.
    pub steps: usize,
    /// Flags of all steps.
    pub flags: u32,
    /// Steps that raised any.
    pub flagged: usize,
    /// The first of them.
    pub first_flagged: Option<usize>,
    /// Tetrahedra that were inside out at once, at most.
    pub inverted: usize,
    /// Laws.
    pub findings: Vec<Finding>,
    /// Why it was refused.
    pub refusal: Option<String>,
    /// Some of its steps, the first and the last among them, where it does not pass.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub trace: Vec<Traced>,
    /// Wall time, s.
    pub seconds: f64,
}

/// What was measured of a step of a case that does not pass.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Traced {
    /// From 1; 0: the start.
    pub step: usize,
    /// Kinetic, elastic, gravity's and the coupling's, J.
    pub energy: f64,
    /// Put in since the start, J.
    pub supplied: f64,
    /// On the tool, N.
    pub force: f64,
    /// Of b - A x, of b; f64.
    pub residual: f64,
    /// What the tool's momentum is missed by, of the largest impulse.
    pub balance: f64,
    /// Tetrahedra inside out.
    pub inverted: usize,
    /// The step's.
    pub flags: u32,
}

impl Judged {
    /// Verdict, flags, and the laws that were broken.
    pub fn in_words(&self) -> String {
        let names: Vec<&str> = Flags(self.flags).names().collect();
        let mut words = vec![self.verdict.name().to_string()];
        if !names.is_empty() {
            words.push(format!("{} in {} of {} steps", names.join(", "), self.flagged, self.steps));
        }
        words.extend(self.findings.iter().filter_map(Finding::in_words));
        words.extend(self.refusal.clone());
        words.join("; ")
    }
}

/// A value of an axis and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct CellResult {
    /// Value with its unit.
    pub label: String,
    /// Whether it must pass.
    pub is_core: bool,
    /// The worst of its cases.
    pub verdict: Verdict,
    /// Its simulations.
    pub cases: Vec<Judged>,
}

/// A row of the matrix.
#[derive(Debug, Clone, Serialize)]
pub struct AxisResult {
    /// Name.
    pub name: String,
    /// For readers.
    pub title: String,
    /// Whether its values are no numbers that rise.
    pub is_listed: bool,
    /// Its values.
    pub cells: Vec<CellResult>,
}

/// All of it.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Version of this format.
    pub schema: u32,
    /// Of palpate.
    pub version: String,
    /// The commit that it was built from, changes since then not counted; `unknown` outside a repository.
    pub commit: String,
    /// Name of the device.
    pub device: String,
    /// Its driver.
    pub driver: String,
    /// Threads of the machine.
    pub threads: usize,
    /// What was asked.
    pub settings: Settings,
    /// Rows.
    pub axes: Vec<AxisResult>,
    /// Wall time, s.
    pub seconds: f64,
}

impl Results {
    /// Every case with its axis and cell.
    pub fn cases(&self) -> impl Iterator<Item = (&AxisResult, &CellResult, &Judged)> {
        let cells = self.axes.iter().flat_map(|axis| axis.cells.iter().map(move |cell| (axis, cell)));
        cells.flat_map(|(axis, cell)| cell.cases.iter().map(move |case| (axis, cell, case)))
    }

    /// What must not happen: failures without a flag, scenes that are refused, and cases of the core that do not pass. A line
    /// each.
    pub fn faults(&self) -> Vec<String> {
        let bad = self.cases().filter(|(_, cell, case)| {
            let is_fault = matches!(case.verdict, Verdict::Silent | Verdict::Refused);
            is_fault || (cell.is_core && case.verdict != Verdict::Pass)
        });
        let line = |(axis, cell, case): (&AxisResult, &CellResult, &Judged)| {
            format!("{} {}, {}: {}", axis.name, cell.label, case.scenario, case.verdict.name())
        };
        bad.map(line).collect()
    }
}
