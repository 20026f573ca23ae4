//! Part `hold` of `palpate bench haptics`: a simulated person presses the tool (rigid body that the haptic device
//! leads) against a surface and holds still, and the noise of the force that the device plays is measured. The device
//! leads the tool by the virtual coupling, a spring and damper.

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

/// The force on a hand that presses a few millimetres deep counts as vanished unless it exceeds this value, N.
const LEAST: f64 = 0.05;
/// Height of the tool at the start above the position in which it first touches the surface, m.
const ABOVE: f64 = 0.003;
/// Depth below the position of first touch to which the person means to press, m.
pub const WITHIN: f64 = 0.005;

/// What the tool is held against.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Met {
    /// A wall of this stiffness, N/m.
    Wall(f64),
    /// The soft head, simulated by the engine.
    Head,
}

/// Results of holding a force, from the last second of the hold.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct HoldResult {
    /// What the tool was held against.
    pub met: Met,
    /// Name of the haptic device's profile.
    pub profile: String,
    /// Rate of the simulation, Hz.
    pub rate: f64,
    /// How the haptic loop used the simulation's wrenches.
    pub mode: Mode,
    /// Force that was played, that is, commanded to the haptic device.
    pub force: Spread,
    /// Force that was played in a second run with a haptic device without friction, since friction alone could hold the
    /// hand still; measured against walls only.
    pub no_friction: Option<Spread>,
    /// Mean and spread of the haptic device's position as the loop read it, m.
    pub reading: Spread,
    /// Forces that one increment of the haptic device's encoders causes: by the stiffness and by the damping of the
    /// virtual coupling, N.
    pub quantum_forces: [f64; 2],
}

/// Whether there is a force (see `is_there`) whose standard deviation is small: at most the share `STILL_SHARE` of the
/// mean force or at most `STILL` (N).
pub fn is_still(force: &Spread) -> bool {
    force.deviation <= (STILL_SHARE * force.mean).max(STILL) && is_there(force)
}

/// Whether the mean force exceeds `LEAST`, that is, has not vanished.
pub fn is_there(force: &Spread) -> bool {
    force.mean > LEAST
}

/// Measures holds against walls and against the head.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<HoldResult>> {
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

/// All combinations of a haptic device, a rate of the simulation (Hz) and a mode.
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
) -> Result<HoldResult> {
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
    Ok(HoldResult {
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

/// Spread of a vector over the ticks (iterations of the haptic loop) of the last second.
fn at_end(ticks: &[Tick], vector: fn(&Tick) -> DVec3) -> Spread {
    let last = &ticks[ticks.len().saturating_sub((1.0 / PERIOD) as usize)..];
    Spread::of_vectors(&last.iter().map(vector).collect::<Vec<_>>())
}
