//! Part `controllers` of `palpate bench haptics`: compares passivity controllers (which keep the energy that the hand
//! receives below the energy that it gave) on a soft body that is pressed, held and released: the controller of
//! palpate's session (its haptic loop), the controller of Hannaford and Ryu (2002), reference energy following (Ryu and
//! others 2005), and no controller. The tool is the rigid body that the haptic device leads by the virtual coupling, a
//! spring and damper.
//!
//! The two published controllers observe only the energy at the haptic device and inject damping there. Instead of the
//! force F they play (command to the device) F' = F - alpha v with alpha = (E_ref - E) / (T v^2), where v is the hand's
//! velocity, T the loop's period and E the energy that the hand gave, less the energy that it received. E_ref is zero
//! in the paper of 2002; in the paper of 2005 it is the energy that the virtual coupling and the local contact model
//! (the loop's force law between simulation steps) store. alpha is at most the damping that the device can render.

use glam::DVec3;
use palpate::internal::haptics::environment::Cushion;
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::{Result, RigidState, Wrench};
use palpate_devices::hand::HandParameters;
use serde::{Deserialize, Serialize};

use super::rig::{Mode, PERIOD, Rig, key, tool};
use super::{Settings, profile};

/// Stiffnesses of the bodies, N/m.
pub const BODIES: [f64; 2] = [300.0, 2000.0];
/// Rates of the simulation, Hz.
pub const RATES: [f64; 2] = [8.0, 60.0];
/// Speed at which the hand presses and releases, m/s.
pub const SPEED: f64 = 0.04;
/// Height of the tool above the body's surface at the start, and depth below this surface to which the hand means to
/// press, m.
const WAY: [f64; 2] = [0.005, 0.012];
/// Time at which the press begins, and time for which the hand holds the greatest depth, s.
const TIMES: [f64; 2] = [0.3, 3.0];

/// A passivity controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Controller {
    /// The controller of palpate's session: it lets the contact force rise only as fast as the hand pays the energy for
    /// it, and damps at the device if the hand has nevertheless received more energy than it gave.
    Session,
    /// B. Hannaford and J.-H. Ryu 2002.
    Observer,
    /// J.-H. Ryu, C. Preusche, B. Hannaford and G. Hirzinger 2005.
    Following,
    /// No controller.
    Off,
}

impl Controller {
    /// All controllers and their names.
    pub const ALL: [(Controller, &'static str); 4] = [
        (Controller::Session, "session"),
        (Controller::Observer, "Hannaford and Ryu 2002"),
        (Controller::Following, "reference energy following 2005"),
        (Controller::Off, "none"),
    ];
}

/// Results of a press with one controller.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Controlled {
    /// The controller.
    pub controller: Controller,
    /// Name of the haptic device's profile.
    pub profile: String,
    /// Stiffness of the body, N/m.
    pub body: f64,
    /// Rate of the simulation, Hz.
    pub rate: f64,
    /// Whether a simulation step without contact reports the gap (distance and direction) from the tool to the body.
    pub gap: bool,
    /// Mean force played in the last second of the hold, divided by the force that body and virtual coupling would
    /// exert as springs in equilibrium.
    pub share: f64,
    /// Standard deviation of the played force in the last second of the hold, N.
    pub deviation: f64,
    /// Energy that the hand received over the whole press, less the energy that it gave, J. This includes energy that
    /// the controller lent to the hand (gave in advance) and that the hand has not repaid.
    pub net: f64,
    /// Greatest energy at any time that had been lent to the hand and that the hand had not repaid, J.
    pub lent: f64,
    /// Share of the ticks (iterations of the haptic loop) in which the controller acted.
    pub acts: f64,
}

/// Measures all controllers on all bodies at all rates with all haptic devices.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Controlled>> {
    let mut all = Vec::new();
    for &name in &settings.devices {
        for (controller, title) in Controller::ALL {
            watch(&format!("controllers: {title}, {name}"));
            for (body, rate, gap) in BODIES
                .into_iter()
                .flat_map(|body| RATES.into_iter().flat_map(move |rate| [(body, rate, true), (body, rate, false)]))
            {
                all.push(press(controller, name, body, rate, gap)?);
            }
        }
    }
    Ok(all)
}

/// State of a published controller, which observes the energy and damps at the haptic device; for [`Controller::Off`]
/// it only observes.
struct Port {
    controller: Controller,
    /// Greatest damping that the controller may inject, N s/m.
    most: f64,
    /// Energy that the hand gave, less what it received, J.
    energy: f64,
    last: Option<(DVec3, Wrench)>,
    acted: u64,
}

impl Port {
    /// Returns the wrench to be played instead of the wrench that the tick commands.
    fn control(&mut self, tick: &Tick) -> Wrench {
        let state = tick.reading.map_or(tick.device, |reading| reading.state);
        if let Some((position, played)) = self.last {
            self.energy -= played.force.dot(state.position - position);
        }
        let reference = if self.controller == Controller::Following { tick.energy.stored } else { 0.0 };
        let (missing, square) = (reference - self.energy, state.velocity.length_squared());
        let mut played = tick.played;
        if self.controller != Controller::Off && missing > 0.0 && square > 0.0 {
            played.force -= (missing / (PERIOD * square)).min(self.most) * state.velocity;
            self.acted += 1;
        }
        self.last = Some((state.position, played));
        played
    }
}

fn press(controller: Controller, name: &'static str, body: f64, rate: f64, gap: bool) -> Result<Controlled> {
    let profile = profile(name)?;
    let mode = if controller == Controller::Session { Mode::Session } else { Mode::Local };
    let rig = Rig { profile, hand: HandParameters::default(), mode };
    let [above, within] = WAY;
    let way = (above + within) / SPEED;
    let [begin, hold] = TIMES;
    let ends = [0.0, begin, begin + way, begin + way + hold, begin + 2.0 * way + hold, begin + 2.0 * way + hold + 0.5];
    let heights = [above, above, -within, -within, above, above];
    let keys: Vec<_> = ends.into_iter().zip(heights).map(|(time, y)| key(time, DVec3::Y * y)).collect();
    let start = tool(DVec3::Y * above);
    let mut cushion = Cushion { tells_gap: gap, ..Cushion::new(body, start.clone()) };
    let (felt, most) = (cushion.felt(), profile.damping);
    let mut port = Port { controller, most, energy: 0.0, last: None, acted: 0 };
    let control = |tick: &mut Tick| tick.played = port.control(tick);
    let schedule = Schedule::at(rate, PERIOD);
    let ticks = match controller {
        Controller::Session => rig.follow(&keys, &start, &mut cushion, schedule)?,
        _ => rig.follow_controlled(&keys, &start, &mut cushion, schedule, control)?,
    };
    let hold_result = |tick: &&Tick| (ends[3] - 1.0..ends[3]).contains(&tick.time);
    let forces = ticks.iter().filter(hold_result).map(|tick| tick.played.force.y);
    let spread = super::rig::Spread::of(forces);
    let device = ticks.iter().rfind(hold_result).map_or(0.0, |tick| tick.device.position.y);
    let still = (-device / (1.0 / felt + 1.0 / rig.coupling().stiffness)).min(profile.max_force);
    let read =
        |tick: &Tick| tick.reading.map_or(tick.device, |reading: palpate::internal::haptics::Reading| reading.state);
    let work = |pair: &[Tick]| {
        let [from, to]: [RigidState; 2] = [read(&pair[0]), read(&pair[1])];
        pair[0].played.force.dot(to.position - from.position)
    };
    let acts = |tick: &&Tick| tick.events.has_any(&[Event::Damped, Event::Unpaid]);
    let acted = if controller == Controller::Session { ticks.iter().filter(acts).count() as u64 } else { port.acted };
    Ok(Controlled {
        controller,
        profile: name.into(),
        body,
        rate,
        gap,
        share: spread.mean / still,
        deviation: spread.deviation,
        net: ticks.windows(2).map(work).sum(),
        lent: ticks.iter().map(|tick| tick.energy.lent).fold(0.0, f64::max),
        acts: acted as f64 / ticks.len().max(1) as f64,
    })
}
