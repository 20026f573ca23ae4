//! `palpate bench accuracy`: what accuracy costs. A knob is a value of a scene (solver tolerance, time step, cell size
//! and others) that is varied while all other values stay; a setting is one of its values. For each setting the
//! benchmark measures the error of the force on the tool (the rigid body that the haptic device leads) against a
//! reference, and the computing time of a step. The results of one knob are a curve; only the curve `presets` varies
//! several knobs together.

pub mod curve;
mod document;
mod front;
mod precision;
mod presets;
mod press;
pub mod race;
pub(crate) mod space;
mod steps;
mod tolerance;
mod twin;

use serde::Serialize;
use serde_json::{Map, Value};

pub use curve::{Curve, Expected, JUST_NOTICEABLE, Judged, Line, Point};
pub use document::section;
pub use presets::{Setting, presets};

use palpate::{Error, Options, Result};

use super::suite::{from_value, to_value};
use super::{Benchmark, Section};

/// Sizes of the scenes, and how often each setting is run.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Number of rounds; a round runs every setting once, or more often if its run is short.
    pub rounds: usize,
    /// Least number of steps of a setting in a round; shorter runs are repeated: see [`race::Rules`].
    pub timed_steps: usize,
    /// Cells of the pressed blocks along x, y and z.
    pub cells: [u32; 3],
    /// Number of steps in which a block is pressed.
    pub steps: usize,
    /// The shortest time step is the longest one halved this number of times.
    pub halvings: u32,
    /// Number of vertices of the skin (surface mesh) of the head that some curves press.
    pub vertices: usize,
    /// Edge of a lattice cell of the head's layer (its tetrahedral mesh), m.
    pub cell: f64,
    /// Whether this is the short form of the benchmark (`--quick`).
    pub is_quick: bool,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
    /// Shaders to replace, for tests that plant faults in shaders: see [`Options::replaced`].
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

/// A curve's errors should span two decades (see `curve.rs`). This is the reason that the report gives where they span
/// less because the smallest ones are rounding errors of single precision.
const SINGLE: &str = "the remaining error is that of single precision";

type Measure = fn(&Settings, &mut dyn FnMut(&str)) -> Result<Curve>;

/// Name of every curve, and the function that measures it.
const CURVES: &[(&str, Measure)] = &[
    ("tolerance", tolerance::by_tolerance),
    ("iterations", tolerance::by_iterations),
    ("layer", space::by_layer),
    ("skin", space::by_skin),
    ("stiffness", space::by_stiffness),
    ("texel", space::by_texel),
    ("proxies", space::by_proxies),
    ("sides", space::by_sides),
    ("time-step", steps::by_time_step),
    ("newton", steps::by_newton),
    ("precision", precision::measure),
    (front::NAME, front::measure),
];

impl Settings {
    /// The whole benchmark.
    pub fn full() -> Settings {
        Settings {
            rounds: 3,
            timed_steps: 24,
            cells: [8, 5, 8],
            steps: 60,
            halvings: 7,
            vertices: 6_000,
            cell: 0.03,
            is_quick: false,
            device: None,
            replaced: Vec::new(),
        }
    }

    /// The rules by which the settings of a curve are run: `stages` names the stages of a step whose times are summed;
    /// `options` are those with which the engine is opened.
    fn rules<'a>(&self, stages: &'a [&'a str], options: &'a Options) -> race::Rules<'a> {
        race::Rules { rounds: self.rounds, timed_steps: self.timed_steps, stages, options }
    }

    /// A short form with smaller blocks and one run of each setting, for a first look; not for figures to quote.
    pub fn quick() -> Settings {
        Settings { rounds: 1, timed_steps: 0, cells: [7, 4, 7], steps: 50, is_quick: true, ..Settings::full() }
    }

    /// Options with which the engine is opened.
    pub fn options(&self) -> Options {
        Options { device: self.device.clone(), replaced: self.replaced.clone(), ..Options::of_program() }
    }
}

/// Names of all curves.
pub fn names() -> impl Iterator<Item = &'static str> {
    CURVES.iter().map(|(name, _)| *name)
}

/// Measures one curve; `watch` is called with the name of each piece of work as it begins. Errors: no curve has this
/// name, the engine cannot be opened, or a run or a reference fails.
pub fn measure(name: &str, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let found = CURVES.iter().find(|(known, _)| *known == name);
    let (_, measure) = found.ok_or_else(|| Error::Simulation(format!("there is no curve `{name}`")))?;
    measure(settings, &mut |what| watch(&format!("{name}: {what}")))
}

/// The largest error divided by the smallest; 1 where there are no errors or all are equal.
fn factor(errors: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = errors.fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    if low < high { high / low } else { 1.0 }
}

fn curves(parts: &Map<String, Value>) -> Result<Vec<Curve>> {
    names().filter_map(|name| parts.get(name)).map(from_value).collect()
}

/// The benchmark `accuracy`; each curve is a part of it, which can be measured by itself.
pub struct Accuracy(pub Settings);

impl Benchmark for Accuracy {
    fn name(&self) -> &'static str {
        "accuracy"
    }

    fn title(&self) -> &'static str {
        "What accuracy costs"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        names().map(Into::into).collect()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        to_value(&measure(part, &self.0, watch)?)
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(document::preface(settings))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&curves(parts)?, &[])
    }

    fn compared(&self, parts: &Map<String, Value>, earlier: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&curves(parts)?, &curves(earlier)?)
    }

    fn faults(&self, parts: &Map<String, Value>) -> Result<Vec<String>> {
        Ok(document::faults(&curves(parts)?))
    }
}
