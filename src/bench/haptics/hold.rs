//! A person who holds still: how still the force keeps.

use glam::DVec3;
use serde::Serialize;

use super::head::{self, CHEEK, Skin};
use super::rig::{PERIOD, Rig, Spread, key, tool, wall};
use super::{Settings, profile};
use crate::Result;
use crate::haptics::devices::hand::HandParameters;
use crate::haptics::environment::Environment;
use crate::haptics::servo::Tick;
use crate::haptics::virtual_time::Schedule;

/// Above what is pressed at the start, m.
const ABOVE: f64 = 0.003;
/// Below it where the person means to be, m.
pub const WITHIN: f64 = 0.005;

/// What is held against.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Met {
    /// A wall of this stiffness, N/m.
    Wall(f64),
    /// The soft head, by the engine.
    Head,
}

/// A force held, and what came of it in its last second.
#[derive(Debug, Clone, Serialize)]
pub struct Held {
    /// Against what.
    pub met: Met,
    /// The device's profile.
    pub profile: &'static str,
    /// Of the simulation, Hz.
    pub rate: f64,
    /// Whether with the local model; else with the raw force.
    pub local_model: bool,
    /// What was played, N.
    pub force: Spread,
    /// Where the device said that it was, m.
    pub reading: Spread,
    /// What one step of its encoders is worth by the coupling, N.
    pub quantum_force: f64,
}

impl Held {
    /// Whether the force's noise is within what is allowed: its standard deviation, `allowed` N or that share of its mean.
    pub fn is_still(&self, share: f64, newtons: f64) -> bool {
        self.force.deviation <= (share * self.force.mean).max(newtons) && self.force.mean > 0.0
    }
}

/// Holds against walls and the head.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Held>> {
    let mut holds = Vec::new();
    for &stiffness in &settings.walls {
        watch(&format!("hold: a wall of {stiffness} N/m"));
        let start = DVec3::Y * ABOVE;
        let touch = DVec3::ZERO;
        for (name, rate, local_model) in cases(&settings.devices, &settings.rates) {
            let mut wall = wall(stiffness, 0.0, start);
            holds.push(hold(Met::Wall(stiffness), [start, touch - DVec3::Y * WITHIN], name, rate, local_model, &mut wall)?);
        }
    }
    let touch = Skin::of(&head::scene(settings, DVec3::ZERO))?.touch(CHEEK)?;
    let start = touch + DVec3::Z * ABOVE;
    let scene = head::scene(settings, start);
    for (name, rate, local_model) in cases(&settings.slide_devices, &settings.head_rates) {
        watch(&format!("hold: the head, {name} at {rate} Hz"));
        let mut simulation = head::open(&scene, settings)?;
        holds.push(hold(Met::Head, [start, touch - DVec3::Z * WITHIN], name, rate, local_model, &mut simulation)?);
    }
    Ok(holds)
}

/// Every device at every rate, with the local model and without.
pub fn cases(devices: &[&'static str], rates: &[f64]) -> Vec<(&'static str, f64, bool)> {
    let of = |name: &&'static str| {
        let name = *name;
        rates.iter().flat_map(move |&rate| [true, false].map(|local_model| (name, rate, local_model)))
    };
    devices.iter().flat_map(of).collect()
}

fn hold(
    met: Met,
    [start, end]: [DVec3; 2],
    name: &'static str,
    rate: f64,
    local_model: bool,
    environment: &mut dyn Environment,
) -> Result<Held> {
    let rig = Rig { profile: profile(name)?, hand: HandParameters::default(), local_model, passivity: true };
    let keys = [key(0.0, start), key(0.3, start), key(0.6, end), key(3.0, end)];
    let ticks = rig.follow(&keys, &tool(start), environment, Schedule::at(rate, PERIOD))?;
    let last = &ticks[ticks.len().saturating_sub((1.0 / PERIOD) as usize)..];
    let of = |vector: fn(&Tick) -> DVec3| Spread::of_vectors(&last.iter().map(vector).collect::<Vec<_>>());
    Ok(Held {
        met,
        profile: name,
        rate,
        local_model,
        force: of(|tick| tick.played.force),
        reading: of(|tick| tick.device.position),
        quantum_force: rig.hand.quantum * rig.coupling().stiffness,
    })
}
