//! `palpate bench accuracy`: what each knob of a scene buys: the error of the force against the time of a step.

mod curve;
mod document;
mod front;
mod precision;
mod press;
pub mod race;
mod steps;
mod tolerance;
mod twin;

use serde::Serialize;

pub use curve::{Curve, Expected, JUST_NOTICEABLE, Line, Point};
pub use document::{document, section};

use crate::gpu::{Context, Options};
use crate::{Error, Result};

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Names of the curves.
    pub curves: Vec<&'static str>,
    /// Runs of each setting.
    pub rounds: usize,
    /// Of the blocks that are pressed, an edge.
    pub cells: [u32; 3],
    /// Steps of a press.
    pub steps: usize,
    /// Halvings of the longest time step.
    pub halvings: u32,
    /// Of the head's skin.
    pub vertices: usize,
    /// Lattice cell of the head's layer, m.
    pub cell: f64,
    /// Whether this is a short form of the whole.
    pub is_quick: bool,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
    /// See [`Options::replaced`].
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

type Measure = fn(&Settings, &mut dyn FnMut(&str)) -> Result<Curve>;

/// Every curve, and what measures it.
const CURVES: &[(&str, Measure)] = &[
    ("tolerance", tolerance::by_tolerance),
    ("iterations", tolerance::by_iterations),
    ("time-step", steps::by_time_step),
    ("newton", steps::by_newton),
    ("precision", precision::measure),
    (front::NAME, front::measure),
];

impl Settings {
    /// All of it.
    pub fn full() -> Settings {
        Settings {
            curves: names().collect(),
            rounds: 3,
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

    /// Smaller bodies, one run: for a first look, not for figures.
    pub fn quick() -> Settings {
        Settings { rounds: 1, cells: [7, 4, 7], steps: 50, is_quick: true, ..Settings::full() }
    }

    /// Only the curves of these names, in the usual order.
    pub fn only(self, names: &[String]) -> Settings {
        let curves = self.curves.iter().copied().filter(|name| names.iter().any(|asked| asked == name)).collect();
        Settings { curves, ..self }
    }

    /// What the engine is opened with.
    pub fn options(&self) -> Options {
        Options { device: self.device.clone(), replaced: self.replaced.clone(), ..Options::default() }
    }
}

/// Of all curves.
pub fn names() -> impl Iterator<Item = &'static str> {
    CURVES.iter().map(|(name, _)| *name)
}

/// Measures one curve; `watch` is told what begins. Errors: no curve of that name, a device or a reference that fails.
pub fn measure(name: &str, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let found = CURVES.iter().find(|(known, _)| *known == name);
    let (_, measure) = found.ok_or_else(|| Error::Simulation(format!("there is no curve `{name}`")))?;
    measure(settings, &mut |what| watch(&format!("{name}: {what}")))
}

/// The contents of `results.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// [`super::SCHEMA`].
    pub schema: u32,
    /// Always `accuracy`.
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
    /// What was found.
    pub curves: Vec<Curve>,
}

/// Measures everything; `watch` is told what begins. Errors: no device, a device or a reference that fails.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let context = Context::new(&settings.options())?;
    let (device, driver) = (context.device_name().into(), context.driver().into());
    drop(context);
    Ok(Results {
        schema: super::SCHEMA,
        benchmark: "accuracy",
        version: env!("CARGO_PKG_VERSION"),
        device,
        driver,
        threads: std::thread::available_parallelism().map_or(1, Into::into),
        settings: settings.clone(),
        curves: settings.curves.iter().map(|name| measure(name, settings, watch)).collect::<Result<_>>()?,
    })
}
