//! Runs the haptic loop as a session (the loop with a device and a simulation in real time) does, but in virtual time
//! and with a simulated hand at the device, so that every run gives the same bits. A tick is one iteration of the loop;
//! a force is played when it is commanded to the haptic device. The tool is the rigid body that the device leads by the
//! virtual coupling, a spring and damper; a wrench is the contact wrench on the tool that a step of the simulation
//! finds.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::haptics::Device;
use palpate::internal::haptics::coupling::{self, Gains};
use palpate::internal::haptics::environment::{Environment, Wall};
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::haptics::virtual_time::{self, Schedule};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::{Coupling, Haptics, Key, Lowered, Profile};
use palpate::{Error, Result};
use palpate_devices::hand::{Hand, HandParameters};
use serde::{Deserialize, Serialize};

/// Period of the loop, s.
pub const PERIOD: f64 = 1e-3;
/// Radius of the tool, a sphere, m.
pub const RADIUS: f64 = 0.01;
/// Mass of the tool, kg.
pub const MASS: f64 = 0.05;

/// How the loop uses the simulation's wrenches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The default of a session: the local contact model (a force law that the loop evaluates between wrenches), and
    /// passivity control (which bounds the energy given to the hand).
    Session,
    /// The local contact model without passivity control.
    Local,
    /// The force of the newest wrench, unchanged until the next one arrives.
    Raw,
}

impl Mode {
    /// All modes and their names.
    pub const ALL: [(Mode, &'static str); 3] =
        [(Mode::Session, "as in a session"), (Mode::Local, "no passivity control"), (Mode::Raw, "raw force")];

    /// The mode's name.
    pub fn name(self) -> &'static str {
        Mode::ALL.iter().find(|(mode, _)| *mode == self).map_or("", |(_, name)| name)
    }
}

/// A haptic device, the simulated hand that holds it, and how the loop uses the simulation's wrenches.
#[derive(Debug, Clone, Copy)]
pub struct Rig {
    /// Profile of the haptic device, from which the gains of the virtual coupling are chosen.
    pub profile: &'static Profile,
    /// The simulated hand.
    pub hand: HandParameters,
    /// How the loop uses the simulation's wrenches.
    pub mode: Mode,
}

impl Rig {
    /// The virtual coupling with the gains that a session with the local contact model would choose.
    pub fn coupling(&self) -> Coupling {
        self.gains().coupling
    }

    /// Lever arm of the tool, m: a rotation counts as a displacement of its angle times this length.
    pub fn arm(&self) -> f64 {
        (inertia() / MASS).sqrt()
    }

    fn gains(&self) -> Gains {
        coupling::choose(self.profile, PERIOD, 0.0, MASS, inertia(), None)
    }

    /// Forces that one increment of the device's encoders causes, N: by the stiffness of the virtual coupling, and by
    /// its damping, with the velocity that the positions of two successive ticks give.
    pub fn quantum_forces(&self) -> [f64; 2] {
        let Coupling { stiffness, damping, .. } = self.coupling();
        let quantum = self.hand.quantum.unwrap_or(self.profile.step());
        [quantum * stiffness, quantum * damping / PERIOD]
    }

    /// Lets the hand follow keys (desired poses at given times) up to the last key, and returns all ticks. `tool` is
    /// the initial state of the tool, `environment` the source of wrenches, and `schedule` says when its steps begin.
    pub fn follow(
        &self,
        keys: &[Key],
        tool: &Tool,
        environment: &mut dyn Environment,
        schedule: Schedule,
    ) -> Result<Vec<Tick>> {
        self.follow_controlled(keys, tool, environment, schedule, |_| ())
    }

    /// Follows keys like [`Rig::follow`], but lets `control` change what a tick plays before it is commanded to the
    /// haptic device.
    pub fn follow_controlled(
        &self,
        keys: &[Key],
        tool: &Tool,
        environment: &mut dyn Environment,
        schedule: Schedule,
        control: impl FnMut(&mut Tick),
    ) -> Result<Vec<Tick>> {
        let [first, .., last] = keys else { return Ok(Vec::new()) };
        let hand = Hand::new(self.hand, Trajectory::new(keys, *first), self.profile.clone());
        self.lead(&mut hand.map_err(Error::Simulation)?, last.time, tool, environment, schedule, control)
    }

    /// Runs the loop with a device for some seconds, and returns all ticks; the other parameters are those of
    /// [`Rig::follow_controlled`].
    pub fn lead(
        &self,
        device: &mut dyn Device,
        seconds: f64,
        tool: &Tool,
        environment: &mut dyn Environment,
        schedule: Schedule,
        control: impl FnMut(&mut Tick),
    ) -> Result<Vec<Tick>> {
        let settings = Settings {
            period: PERIOD,
            limits: Limits::new(self.profile, &Lowered::default()).0,
            local_model: self.mode != Mode::Raw,
            passivity: self.mode == Mode::Session,
            most_damping: self.gains().most_damping,
            trust: Haptics::default().trust,
            arm: self.arm(),
            resolution: self.profile.step(),
        };
        let mut servo = Servo::new(settings, Tool { coupling: Some(self.coupling()), ..tool.clone() });
        device.open().map_err(|fault| Error::Simulation(fault.to_string()))?;
        let count = (seconds / PERIOD).round() as u64;
        let mut ticks = Vec::with_capacity(count as usize);
        let each = |tick: &Tick| ticks.push(*tick);
        virtual_time::run_controlled(device, &mut servo, environment, schedule, count, control, each)?;
        Ok(ticks)
    }
}

/// Moment of inertia of the tool, a sphere, kg m^2.
fn inertia() -> f64 {
    0.4 * MASS * RADIUS * RADIUS
}

/// The tool at rest, with its centre at `centre` (m).
pub fn tool(centre: DVec3) -> Tool {
    Tool {
        mass: MASS,
        inertia: DMat3::IDENTITY * inertia(),
        coupling: None,
        centre,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    }
}

/// A key: the desired pose of the hand at a time (s).
pub fn key(time: f64, position: DVec3) -> Key {
    Key { time, position, orientation: DQuat::IDENTITY }
}

/// A wall of this stiffness (N/m) and damping (N s/m), for a tool whose centre starts at `centre` (m).
pub fn wall(stiffness: f64, damping: f64, centre: DVec3) -> Wall {
    Wall { stiffness, damping, tells_gap: true, tool: tool(centre), steps: 0 }
}

/// An environment that records all wrenches that it returns.
pub struct Recorded<'a> {
    /// The environment that computes the wrenches.
    pub inner: &'a mut dyn Environment,
    /// The wrenches that `inner` returned, in the order of the steps.
    pub wrenches: Vec<ContactWrench>,
}

impl Environment for Recorded<'_> {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let wrenches = self.inner.feel_each(inputs, h)?;
        self.wrenches.extend(&wrenches);
        Ok(wrenches)
    }
}

/// Mean and spread of a force (in N) or of a position (in m).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// The greatest value minus the least one.
    pub swing: f64,
}

impl Spread {
    /// The spread of samples; zero if there are none.
    pub fn of(samples: impl Iterator<Item = f64> + Clone) -> Spread {
        let count = samples.clone().count().max(1) as f64;
        let mean = samples.clone().sum::<f64>() / count;
        let variance = samples.clone().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        let (low, high) = samples.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        Spread { mean, deviation: variance.sqrt(), swing: (high - low).max(0.0) }
    }

    /// The spread of vectors. Its `mean` is the length of the mean vector, its `deviation` the root of the sum of the
    /// variances of all axes, and its `swing` the diagonal of the vectors' bounding box.
    pub fn of_vectors(vectors: &[DVec3]) -> Spread {
        let axes: [Spread; 3] = std::array::from_fn(|k| Spread::of(vectors.iter().map(|v| v[k])));
        let length = |part: fn(&Spread) -> f64| DVec3::from(axes.each_ref().map(part)).length();
        Spread { mean: length(|s| s.mean), deviation: length(|s| s.deviation), swing: length(|s| s.swing) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_of_what_was_sampled() {
        let spread = Spread::of([1.0, 3.0, 1.0, 3.0].into_iter());
        assert_eq!(spread, Spread { mean: 2.0, deviation: 1.0, swing: 2.0 });
        assert_eq!(Spread::of(std::iter::empty()), Spread::default());
        let vectors = [DVec3::new(0.0, 4.0, 3.0), DVec3::new(0.0, 10.0, 11.0)];
        assert_eq!(Spread::of_vectors(&vectors), Spread { mean: 98f64.sqrt(), deviation: 5.0, swing: 10.0 });
    }

    #[test]
    fn a_rig_presses_against_a_wall_and_gives_the_same_bits_twice() {
        let profile = Profile::named("premium").unwrap();
        let rig = Rig { profile, hand: HandParameters::default(), mode: Mode::Local };
        let start = DVec3::Y * 0.002;
        let keys = [key(0.0, start), key(0.3, start), key(0.4, DVec3::Y * -0.005), key(1.0, DVec3::Y * -0.005)];
        let run = || {
            let mut wall = wall(500.0, 0.0, start);
            let mut recorded = Recorded { inner: &mut wall, wrenches: Vec::new() };
            let ticks = rig.follow(&keys, &tool(start), &mut recorded, Schedule::at(100.0, PERIOD)).unwrap();
            (ticks.last().unwrap().played.force.y, ticks.len(), recorded.wrenches.len())
        };
        let (force, ticks, steps) = run();
        // The force in equilibrium of arm, virtual coupling and wall as springs in series. Friction of the device lets
        // the played force differ from this by up to 0.05 N.
        let exact = 0.005 / (1.0 / 300.0 + 1.0 / 500.0 + 1.0 / rig.coupling().stiffness);
        assert!((force - exact).abs() < 0.05, "played force {force} N, expected {exact} N");
        assert_eq!((ticks, steps), (1000, 100));
        assert_eq!(run().0.to_bits(), force.to_bits());
        assert!(
            rig.follow(&keys[..1], &tool(start), &mut wall(1.0, 0.0, start), Schedule::at(100.0, PERIOD))
                .unwrap()
                .is_empty()
        );
    }
}
