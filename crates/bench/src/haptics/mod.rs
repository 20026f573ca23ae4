//! `palpate bench haptics`: what the hand feels of the haptic loop. The benchmark measures how stiff a wall may be
//! before the loop oscillates, how still a held force is, how far a force jumps while sliding, how well the loop knows
//! the force between two steps of the simulation, how passivity controllers (which bound the energy given to the hand)
//! compare, and how punctual the loop's ticks (its 1 kHz iterations) are. The tool is the rigid body that the haptic
//! device leads.

pub(super) mod between;
mod controllers;
mod document;
pub(super) mod head;
mod hold;
mod jitter;
mod rig;
mod slide;
mod width;

use serde::Serialize;
use serde_json::{Map, Value};

pub use between::{Between, Place};
pub use controllers::{Controlled, Controller};
pub use hold::{HoldResult, Met, is_still};
pub use jitter::Punctual;
pub use rig::{Mode, Spread};
pub use slide::{Change, Changes, Slid};
pub use width::{Limit, Width};

use palpate::scene::Profile;
use palpate::{Error, Result};

use super::suite::{part, to_value};
use super::{Benchmark, Section};

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Names of the haptic devices' profiles.
    pub devices: Vec<&'static str>,
    /// Damping of the walls, N s/m.
    pub dampings: Vec<f64>,
    /// Delays of the force between the loop and the haptic device, s.
    pub delays: Vec<f64>,
    /// Rates of the simulation where the tool is pressed against walls, Hz.
    pub rates: Vec<f64>,
    /// Relative accuracy to which bisection finds the stiffest wall.
    pub bisected: f64,
    /// Stiffnesses of the walls against which a force is held, N/m.
    pub walls: Vec<f64>,
    /// Rates of the engine's simulation of a soft head against which a force is held, Hz.
    pub head_rates: Vec<f64>,
    /// Rates of the engine's simulation at which the tool slides over the head, Hz.
    pub slide_rates: Vec<f64>,
    /// Profiles of the haptic devices with which a force is held on the head and the tool slides over it.
    pub slide_devices: Vec<&'static str>,
    /// Rates of the engine's simulation in the comparison of forces between steps, Hz.
    pub between_rates: Vec<f64>,
    /// Where the tool is pressed in in that comparison.
    pub between_places: Vec<Place>,
    /// Young's moduli of the bodies in that comparison, Pa.
    pub between_moduli: Vec<f64>,
    /// Number of vertices of the head's skin (its surface mesh).
    pub vertices: usize,
    /// Edge of a lattice cell of the head's layer (its tetrahedral mesh), m.
    pub cell: f64,
    /// Real time of each measurement of the ticks' lateness, s.
    pub jitter_seconds: f64,
    /// Whether this is the short form of the benchmark (`--quick`).
    pub is_quick: bool,
    /// GPU device that simulates, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark, which takes some twenty minutes on two CPU cores.
    pub fn full() -> Settings {
        Settings {
            devices: vec!["touch", "premium", "sigma.7"],
            dampings: vec![0.0, 2.0, 5.0, 10.0, 20.0, 50.0],
            delays: vec![0.0, 2e-3, 5e-3, 10e-3, 20e-3],
            rates: vec![30.0, 60.0, 125.0, 250.0, 500.0, 1000.0],
            bisected: 0.02,
            walls: vec![500.0, 2000.0],
            head_rates: vec![30.0, 50.0, 125.0],
            slide_rates: vec![40.0, 50.0],
            slide_devices: vec!["touch", "premium", "sigma.7", "falcon", "omega.x", "delta.6", "inverse3", "minverse"],
            between_rates: vec![20.0, 30.0, 50.0, 100.0, 200.0],
            between_places: Place::ALL.into(),
            between_moduli: vec![2e4, 2e6],
            vertices: 44_000,
            cell: 0.018,
            jitter_seconds: 10.0,
            is_quick: false,
            device: None,
        }
    }

    /// A short form with one haptic device and few cases, for a first look; not for figures to quote.
    pub fn quick() -> Settings {
        Settings {
            devices: vec!["premium"],
            dampings: vec![0.0, 10.0],
            delays: vec![0.0, 5e-3, 20e-3],
            rates: vec![30.0, 125.0, 1000.0],
            bisected: 0.1,
            head_rates: vec![50.0],
            slide_rates: vec![50.0],
            between_rates: vec![50.0],
            between_places: vec![Place::Cheek],
            slide_devices: vec!["premium"],
            jitter_seconds: 3.0,
            is_quick: true,
            ..Settings::full()
        }
    }

    /// Profiles of the haptic devices. Errors: a name is unknown.
    fn profiles(&self) -> Result<Vec<&'static Profile>> {
        self.devices.iter().map(|name| profile(name)).collect()
    }
}

fn profile(name: &str) -> Result<&'static Profile> {
    Profile::named(name).ok_or_else(|| Error::Simulation(format!("there is no device profile `{name}`")))
}

/// Results of the benchmark; the lists of parts that were not measured are empty.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// Stiffest walls without oscillation, for different dampings of the wall.
    pub widths: Vec<Width>,
    /// Stiffest walls without oscillation, for different delays of the force.
    pub delays: Vec<Limit>,
    /// Stiffest walls without oscillation, for different rates of the simulation.
    pub rates: Vec<Limit>,
    /// Forces while a simulated person holds still.
    pub holds: Vec<HoldResult>,
    /// Forces while a simulated person slides the tool over the head.
    pub slides: Vec<Slid>,
    /// Forces between the steps of the simulation.
    pub between: Vec<Between>,
    /// Presses into a soft body with different passivity controllers.
    pub controllers: Vec<Controlled>,
    /// Lateness of ticks.
    pub jitter: Vec<Punctual>,
}

impl Results {
    /// Reads the results of the parts that were measured. Errors: a part does not have the form of this benchmark's
    /// results.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let [widths, delays, rates, holds, slides, between, controllers, jitter] = PARTS;
        Ok(Results {
            widths: part(parts, widths)?,
            delays: part(parts, delays)?,
            rates: part(parts, rates)?,
            holds: part(parts, holds)?,
            slides: part(parts, slides)?,
            between: part(parts, between)?,
            controllers: part(parts, controllers)?,
            jitter: part(parts, jitter)?,
        })
    }
}

/// Names of the parts of the benchmark, in the order of the lists of [`Results`].
const PARTS: [&str; 8] = ["damping", "delay", "rate", "hold", "slide", "between", "controllers", "ticks"];

/// The benchmark `haptics`; each of its parts measures one list of [`Results`].
pub struct Haptics(pub Settings);

impl Benchmark for Haptics {
    fn name(&self) -> &'static str {
        "haptics"
    }

    fn title(&self) -> &'static str {
        "What the hand feels of the loop"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        PARTS.map(Into::into).into()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        let settings = &self.0;
        match part {
            "damping" => to_value(&width::by_damping(settings, watch)?),
            "delay" => to_value(&width::by_delay(settings, watch)?),
            "rate" => to_value(&width::by_rate(settings, watch)?),
            "hold" => to_value(&hold::measure(settings, watch)?),
            "controllers" => to_value(&controllers::measure(settings, watch)?),
            "slide" => to_value(&slide::measure(settings, watch)?),
            "between" => to_value(&between::measure(settings, watch)?),
            _ => to_value(&jitter::measure(settings, watch)?),
        }
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(document::preface(settings))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&Results::of(parts)?)
    }
}
