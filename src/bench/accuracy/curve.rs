//! Error against run time: a curve, its points, and what they say.

use serde::{Deserialize, Serialize};

use crate::bench::median;

/// Changes of a force that a person just notices, of the force (see README, "bench").
pub const JUST_NOTICEABLE: f64 = 0.07;

/// What one knob of a scene buys: error and time of each of its settings, measured turn by turn.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Curve {
    /// Short name, as in `--only`: `tolerance`.
    pub name: String,
    /// Heading.
    pub title: String,
    /// What was asked, of which scene, and what the error is measured against.
    pub question: String,
    /// What the settings are numbers of, with its unit: `time step, ms`.
    pub knob: String,
    /// Which stage the knob is about; its time stands beside the step's.
    pub stage: String,
    /// Setting by setting, in the order of the knob.
    pub points: Vec<Point>,
    /// The order of convergence that theory expects of the force, and why; `None`: the knob has none.
    pub expected: Option<Expected>,
    /// Why the order is another, or the errors span less than two decades; empty where neither is so.
    pub reason: String,
}

/// What theory says of an error: that it falls as a power of the knob.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Expected {
    /// The power.
    pub order: f64,
    /// By which law.
    pub law: String,
}

/// A setting and what was measured.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Point {
    /// What it is called in a table: `jacobi to 1e-4`.
    pub setting: String,
    /// Which of the curve's lines it is on; empty where there is one.
    pub line: String,
    /// The knob's number.
    pub value: f64,
    /// Error of the net force, of the reference's; `None`: nothing is touched, or it is not finite.
    pub force_error: Option<f64>,
    /// Error of the displacements, largest over the largest of the reference's; `None` as above.
    pub displacement_error: Option<f64>,
    /// Solver iterations of a step, median.
    pub iterations: f64,
    /// Names of the flags that were raised.
    pub flags: Vec<String>,
    /// Microseconds of the curve's stage, a step each, for each round.
    pub stage_us: Vec<Vec<f64>>,
    /// Microseconds of a step, pose in and wrench out, for each round.
    pub step_us: Vec<Vec<f64>>,
    /// Seconds of the simulated world that a step is, where points differ in it; else 0.
    pub simulated_s: f64,
}

impl Point {
    /// Milliseconds of a step: the median over the steps of a round, the median of those.
    pub fn step_ms(&self) -> f64 {
        ms(&self.step_us)
    }

    /// The same of the stage.
    pub fn stage_ms(&self) -> f64 {
        ms(&self.stage_us)
    }
}

fn ms(rounds: &[Vec<f64>]) -> f64 {
    1e-3 * median(&rounds.iter().map(|round| median(round)).collect::<Vec<_>>())
}
