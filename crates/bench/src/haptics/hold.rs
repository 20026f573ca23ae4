//! A person who holds still: how still the force keeps.

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate_devices::hand::HandParameters;
use serde::{Deserialize, Serialize};

use super::head::{self, CHEEK, Skin};
use super::rig::{Mode, PERIOD, Rig, Spread, key, tool, wall};
use super::width::{STILL, STILL_SHARE};
use super::{Settings, profile};

/// A hand that presses a few millimetres deep and feels less than this has been left without a force, N.
const LEAST: f64 = 0.05;
/// Above what is pressed at the start, m.
const ABOVE: f64 = 0.003;
/// Below it where the person means to be, m.
pub const WITHIN: f64 = 0.005;

/// What is held against.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Met {
    /// A wall of this stiffness, N/m.
    Wall(f64),
    /// The soft head, by the engine.
    Head,
}

/// A force held, and what came of it in its last second.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Held {
    /// Against what.
    pub met: Met,
    /// The device's profile.
    pub profile: String,
    /// Of the simulation, Hz.
    pub rate: f64,
    /// What the loop did.
    pub mode: Mode,
    /// What was played, N.
    pub force: Spread,
    /// The same where the device has no friction to rest in; walls alone.
    pub no_friction: Option<Spread>,
    /// Where the device said that it was, m.
    pub reading: Spread,
    /// What one step of its encoders is worth by the coupling's stiffness and by its damping, N.
    pub quantum_forces: [f64; 2],
}

/// Whether there is a force, and its standard deviation is within `STILL_SHARE` of it or `STILL`.
pub fn is_still(force: &Spread) -> bool {
    force.deviation <= (STILL_SHARE * force.mean).max(STILL) && is_there(force)
}

/// Whether there is a force at all.
pub fn is_there(force: &Spread) -> bool {
    force.mean > LEAST
}

/// Holds against walls and the head.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Held>> {
    let mut holds = Vec::new();
    for &stiffness in &settings.walls {
        watch(&format!("hold: a wall of {stiffness} N/m"));
        let start = DVec3::Y * ABOVE;
        let touch = DVec3::ZERO;
        for (name, rate, mode) in cases(&settings.devices, &settings.rates) {
            let mut wall = wall(stiffness, 0.0, start);
            holds.push(hold(Met::Wall(stiffness), [start, touch - DVec3::Y * WITHIN], name, rate, mode, &mut wall)?);
        }
    }
    let touch = Skin::of(&head::scene(settings, DVec3::ZERO))?.touch(CHEEK)?;
    let start = touch + DVec3::Z * ABOVE;
    let scene = head::scene(settings, start);
    for (name, rate, mode) in cases(&settings.slide_devices, &settings.head_rates) {
        watch(&format!("hold: the head, {name} at {rate} Hz"));
        let mut simulation = head::open(&scene, settings)?;
        holds.push(hold(Met::Head, [start, touch - DVec3::Z * WITHIN], name, rate, mode, &mut simulation)?);
    }
    Ok(holds)
}

/// Every device at every rate in every mode.
pub fn cases(devices: &[&'static str], rates: &[f64]) -> Vec<(&'static str, f64, Mode)> {
    let of = |name: &&'static str| {
        let name = *name;
        rates.iter().flat_map(move |&rate| Mode::ALL.map(|(mode, _)| (name, rate, mode)))
    };
    devices.iter().flat_map(of).collect()
}

fn hold(
    met: Met,
    [start, end]: [DVec3; 2],
    name: &'static str,
    rate: f64,
    mode: Mode,
    environment: &mut dyn Environment,
) -> Result<Held> {
    let rig = Rig { profile: profile(name)?, hand: HandParameters::default(), mode };
    let keys = [key(0.0, start), key(0.3, start), key(0.6, end), key(3.0, end)];
    let ticks = rig.follow(&keys, &tool(start), environment, Schedule::at(rate, PERIOD))?;
    let no_friction = match met {
        Met::Wall(stiffness) => {
            let rig = Rig { hand: HandParameters { friction: 0.0, ..rig.hand }, ..rig };
            let mut wall = wall(stiffness, 0.0, start);
            Some(at_end(&rig.follow(&keys, &tool(start), &mut wall, Schedule::at(rate, PERIOD))?, |t| t.played.force))
        }
        Met::Head => None,
    };
    Ok(Held {
        met,
        profile: name.into(),
        rate,
        mode,
        force: at_end(&ticks, |tick| tick.played.force),
        no_friction,
        reading: at_end(&ticks, |tick| tick.device.position),
        quantum_forces: rig.quantum_forces(),
    })
}

/// Over the last second.
fn at_end(ticks: &[Tick], vector: fn(&Tick) -> DVec3) -> Spread {
    let last = &ticks[ticks.len().saturating_sub((1.0 / PERIOD) as usize)..];
    Spread::of_vectors(&last.iter().map(vector).collect::<Vec<_>>())
}
