//! `palpate stability`: a matrix of stiff and extreme simulations of a soft block, each with a verdict from invariants
//! (conditions that are checked in every step). An axis, one row of the matrix, is a quantity that is varied; a cell is
//! one of its values; a case is one simulation with this value. A flag is the engine's report of a problem in a step.
//!
//! `axes` lists the axes and their values. `cases` says what is done to the block in each kind of case and which
//! invariants must hold in addition to those of every step. `setup` makes the scene, `trace` measures each step from
//! outside the engine in f64, `invariants` judges the measured steps, and `document` writes the report.

pub mod axes;
pub mod cases;
pub mod document;
mod equations;
mod heat_map;
pub mod invariants;
mod joined;
mod labels;
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

use invariants::{Finding, Verdict};

/// Version of the format of `results.json`: raised when a field changes its meaning or is removed.
pub const SCHEMA: u32 = 2;

/// Which part of the matrix is run, and how.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Settings {
    /// Whether the short form of the matrix is run (`--quick`), with fewer values and steps.
    pub is_quick: bool,
    /// Whether a case of a million steps is added in which the block rests on a floor (`--soak`).
    pub is_soak: bool,
    /// Names of the axes to run; empty: all of them.
    pub only: Vec<String>,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
    /// Shaders to replace, for tests that plant faults: see [`palpate::Options::replaced`].
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

/// One case and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// Name of what is done to the block; it distinguishes the cases of a cell.
    pub scenario: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Number of steps that were done.
    pub steps: usize,
    /// Flags of all steps together, as a bit mask.
    pub flags: u32,
    /// Number of steps that raised a flag.
    pub flagged: usize,
    /// Number of the first step that raised a flag; `None`: no step did.
    pub first_flagged: Option<usize>,
    /// Greatest number of tetrahedra that were inside out in one step.
    pub inverted: usize,
    /// How each invariant was kept in its worst step.
    pub findings: Vec<Finding>,
    /// The engine's error message, if it refused the scene.
    pub refusal: Option<String>,
    /// Some of the steps, including the first and the last, of a case that does not pass; empty for one that passes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub trace: Vec<Traced>,
    /// Wall time, s.
    pub seconds: f64,
}

/// Measurements of one step of a case that does not pass.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Traced {
    /// Number of the step, from 1; 0: the start.
    pub step: usize,
    /// Sum of kinetic energy, elastic energy, gravitational energy and energy of the virtual coupling (spring between
    /// haptic device and tool), J.
    pub energy: f64,
    /// Energy supplied from outside since the start, J.
    pub supplied: f64,
    /// Magnitude of the contact force on the tool, the rigid body that the haptic device leads, N.
    pub force: f64,
    /// Residual b - A x of the step's linear system, computed in f64, relative to b.
    pub residual: f64,
    /// Difference of the tool's change of momentum from the impulses on it, relative to the largest impulse.
    pub balance: f64,
    /// Number of tetrahedra that are inside out.
    pub inverted: usize,
    /// Flags of the step, as a bit mask.
    pub flags: u32,
}

impl Judged {
    /// Verdict, flags and broken invariants as text.
    pub fn in_words(&self) -> String {
        let names: Vec<&str> = Flags(self.flags).names().collect();
        let mut words = vec![self.verdict.name().to_string()];
        if !names.is_empty() {
            words.push(format!("flags {} in {} of {} steps", names.join(", "), self.flagged, self.steps));
        }
        words.extend(self.findings.iter().filter_map(Finding::in_words));
        words.extend(self.refusal.clone());
        words.join("; ")
    }
}

/// A cell: one value of an axis, and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct CellResult {
    /// The value as text, with its unit.
    pub label: String,
    /// Whether all cases of the value must pass.
    pub is_core: bool,
    /// The worst verdict of the value's cases.
    pub verdict: Verdict,
    /// The cases with this value.
    pub cases: Vec<Judged>,
}

/// A row of the matrix: an axis with its cells.
#[derive(Debug, Clone, Serialize)]
pub struct AxisResult {
    /// Name of the axis on the command line.
    pub name: String,
    /// Title in the report.
    pub title: String,
    /// Whether the values are alternatives in words instead of ascending numbers.
    pub is_listed: bool,
    /// The cells of the axis.
    pub cells: Vec<CellResult>,
}

/// Results of a run of the matrix.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Version of the format of these results.
    pub schema: u32,
    /// Version of palpate.
    pub version: String,
    /// The git commit that palpate was built from, with `-changed` if the sources differed from it; `unknown` outside a
    /// repository.
    pub commit: String,
    /// Name of the GPU device.
    pub device: String,
    /// Name and version of the GPU driver.
    pub driver: String,
    /// Number of hardware threads of the machine.
    pub threads: usize,
    /// The part of the matrix that was run.
    pub settings: Settings,
    /// Rows of the matrix.
    pub axes: Vec<AxisResult>,
    /// Wall time of the run, s.
    pub seconds: f64,
}

impl Results {
    /// Every case with its axis and cell.
    pub fn cases(&self) -> impl Iterator<Item = (&AxisResult, &CellResult, &Judged)> {
        let cells = self.axes.iter().flat_map(|axis| axis.cells.iter().map(move |cell| (axis, cell)));
        cells.flat_map(|(axis, cell)| cell.cases.iter().map(move |case| (axis, cell, case)))
    }

    /// Requirements that were not met, a line for each: failures without a flag, refused scenes, and cases that must
    /// pass but do not.
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
