//! One tick (iteration) of the haptic loop, from a reading of the haptic device to the wrench that is *played*, that is
//! commanded to the device: it uses no clock, no thread and no allocation, and gives the same bits for the same inputs.
//!
//! The *tool*, a rigid body simulated here, follows the device by virtual coupling (spring and damper) and feels
//! contact by the local model (linear force law, `local_model.rs`) of the newest contact wrench that the simulation
//! gave. The hand feels the reaction of the coupling's pull on the tool, after passivity control (`passivity.rs`) and
//! safety limits (`safety.rs`), times the *gain*: a share (0 to 1) that falls when the force must fade and rises again
//! after that.

use glam::DVec3;
use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::device::{Fault, Reading};
use super::event::{Event, Events};
use super::follow::{Followed, Rules};
use super::local_model::vector;
use super::passivity::{Energy, Passivity};
use super::safety::{Gain, Guard, Limits};
use super::sense::Sense;
use crate::step::tool::Tool;
use crate::step::{ContactWrench, DeviceInput, RigidState, Wrench};

/// A tick that begins more than this time after its deadline is late, s.
const LATE: f64 = 2e-3;
/// Longest time that a tick may integrate over, in periods, even if the clock advanced by more.
const LONGEST_TICK: f64 = 4.0;
/// Greatest change of the force that one encoder step may cause, through the coupling's stiffness or through its
/// damping, N.
const SMOOTHED_STEP: f64 = 0.02;
/// Longest time constant of the smoothing of the device's pose, s: smoothing is delay, and delay costs stability.
const LONGEST_SMOOTHING: f64 = 0.001;
/// Shortest time that a tick may integrate over, in periods.
const SHORTEST_TICK: f64 = 0.25;
/// A clock that advances by more than this time between two ticks has jumped, s.
const LONGEST_GAP: f64 = 0.25;
/// While the simulation returns wrenches that are not finite, the force fades if the last finite wrench is older than
/// this, s.
const LONGEST_BAD: f64 = 0.25;
/// Longest time over which a new wrench is blended in, s: the blend takes the interval since the last wrench if that is
/// shorter. With a longer time the felt contact would lag behind a body that moves.
const LONGEST_BLEND: f64 = 0.02;
/// Without contact, a coupling force below this share of the force limit is played in full at once, because a force
/// this small need not fade in.
const NOTHING_TO_FADE: f64 = 0.02;

/// Settings of a [`Servo`]. Together with the device's readings and the simulation's wrenches they determine every bit
/// of the wrench that is played.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Period of a tick, s.
    pub period: f64,
    /// Limits on the wrench that is played.
    pub limits: Limits,
    /// Whether the contact wrench follows the tool by the local model; otherwise the newest wrench is kept constant.
    pub local_model: bool,
    /// Whether the passivity controller acts; energy is observed in any case.
    pub passivity: bool,
    /// Greatest damping that the passivity controller may inject: linear, N s/m, and about any axis, N m s/rad.
    pub most_damping: [f64; 2],
    /// The local model is trusted while the tool is within this distance, m, of its pose in the newest wrench.
    pub trust: f64,
    /// Lever arm, m: a rotation of the tool counts as a displacement of its angle (rad) times this length.
    pub arm: f64,
    /// Resolution of the device's positions (the step of its encoders), m.
    pub resolution: f64,
}

/// Record of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// Number of the tick, from 0.
    pub index: u64,
    /// Beginning of the tick, s on the loop's clock.
    pub time: f64,
    /// Delay of the tick after its deadline, s.
    pub late: f64,
    /// The device's reading; `None` if the device could not be read.
    pub reading: Option<Reading>,
    /// Pose and twist of the device that the tick used: checked and smoothed.
    pub device: RigidState,
    /// Pose and twist of the tool at the end of the tick.
    pub tool: RigidState,
    /// Contact wrench on the tool, from the local model.
    pub contact: Wrench,
    /// The wrench played to the hand.
    pub played: Wrench,
    /// Number of the simulation step that gave the newest wrench; 0 if there was no wrench yet.
    pub step: u64,
    /// Age of the newest wrench: time since the inputs of its step were taken, s.
    pub staleness: f64,
    /// Share of the force that is played, from 0 to 1.
    pub gain: f64,
    /// Linear damping that the passivity controller injected, N s/m.
    pub damping: f64,
    /// Energies observed so far.
    pub energy: Energy,
    /// Unusual events of the tick.
    pub events: Events,
}

/// State of the loop between ticks.
#[derive(Debug, Clone)]
pub struct Servo {
    settings: Settings,
    tool: Tool,
    sense: Sense,
    /// Pose and twist of the device: the accepted reading (`sensed`), and smoothed (`device`).
    sensed: RigidState,
    device: RigidState,
    contact: Followed,
    /// Contact wrench on the tool in the last tick.
    felt: Wrench,
    gain: Gain,
    /// Value of `gain` when the energy balance was last updated.
    last_gain: f64,
    guard: Guard,
    passivity: Passivity,
    index: u64,
    time: Option<f64>,
    /// Centre of the workspace: the device's first position, m.
    home: DVec3,
    played: Wrench,
}

impl Servo {
    /// Makes a servo with this tool, coupled to a device that has not been read yet and is taken to be at the tool's
    /// pose.
    pub fn new(settings: Settings, tool: Tool) -> Servo {
        let start = tool.state();
        let Settings { local_model, arm, trust, limits, .. } = settings;
        Servo {
            sense: Sense::new(start),
            sensed: start,
            device: start,
            contact: Followed::new(
                Rules { local_model, arm, trust, longest: limits.watchdog.min(LONGEST_BLEND) },
                start,
            ),
            felt: Wrench::ZERO,
            gain: Gain::default(),
            last_gain: 0.0,
            guard: Guard::new(settings.limits),
            passivity: Passivity::new(settings.passivity, !local_model, settings.most_damping, settings.resolution),
            index: 0,
            time: None,
            home: start.position,
            played: Wrench::ZERO,
            settings,
            tool,
        }
    }

    /// Runs one tick at `time` (s), which began `late` s after its deadline: takes the device's reading and returns the
    /// wrench to play. `newest` is the newest wrench of the simulation, which may be the same wrench as in the last
    /// tick.
    pub fn tick(&mut self, time: f64, late: f64, reading: Result<Reading, Fault>, newest: &ContactWrench) -> Tick {
        let mut events = Events::default();
        let period = self.clock(time, late, &mut events);
        let (device, is_well) = self.feel_for(&reading, period, &mut events);
        self.take(newest, time, &mut events);
        let newest = self.contact.newest();
        let (step, staleness) = (newest.step, if newest.step > 0 { time - newest.time } else { 0.0 });
        // A wrench whose time is in the future or unknown (NaN) is trusted as little as one that is out of date.
        let longest = match events.has(Event::BadWrench) {
            true => self.settings.limits.watchdog.min(LONGEST_BAD),
            false => self.settings.limits.watchdog,
        };
        if staleness.is_nan() || staleness.abs() > longest {
            events.raise(Event::StaleWrench);
        }
        if (device.position - self.home).length() > self.settings.limits.workspace {
            events.raise(Event::OutsideWorkspace);
        }
        let fading = events.has_any(&[Event::StaleWrench, Event::OutsideWorkspace]);
        let is_well = is_well && !fading && step > 0;
        let touches = self.felt != Wrench::ZERO || self.contact.newest().wrench != Wrench::ZERO;
        if is_well && !touches && self.pulls_little(&device) {
            self.gain.fill();
        }
        self.gain.go(is_well, period);
        if events.has_any(&[Event::DeviceLost, Event::ClockJump]) {
            self.gain.cut();
        }
        if self.gain.value() < 1.0 {
            events.raise(Event::Engaging);
        }
        self.device = device;
        self.felt = self.move_tool(&device, period, &mut events);
        let (played, damping) = self.play(&device, period, &mut events);
        let tick = Tick {
            index: self.index,
            time,
            late,
            reading: reading.ok(),
            device,
            tool: self.tool.state(),
            contact: self.felt,
            played,
            step,
            staleness,
            gain: self.gain.value(),
            damping,
            energy: self.passivity.energy(),
            events,
        };
        self.index += 1;
        tick
    }

    /// The state of device and tool from which a simulation step that begins now starts.
    pub fn input(&self) -> DeviceInput {
        let time = self.time.unwrap_or(0.0);
        let coupling = self.tool.coupling.filter(|_| self.index > 0);
        let max_force = self.settings.limits.force;
        DeviceInput { ticks: self.index, time, device: self.device, tool: self.tool.state(), coupling, max_force }
    }

    /// The newest wrench taken.
    pub fn newest(&self) -> ContactWrench {
        *self.contact.newest()
    }

    /// Period of a tick, s.
    pub fn period(&self) -> f64 {
        self.settings.period
    }

    /// Notes that the device could not be commanded: nothing was played, and the force rises from zero again.
    pub fn unplayed(&mut self, tick: &mut Tick) {
        tick.events.raise(Event::DeviceLost);
        tick.played = self.guard.cut();
        self.played = tick.played;
        self.gain.cut();
        self.passivity.play(tick.played);
    }

    /// Checks the clock and returns the time over which the tick integrates, s.
    fn clock(&mut self, time: f64, late: f64, events: &mut Events) -> f64 {
        if late > LATE {
            events.raise(Event::LateTick);
        }
        let nominal = self.settings.period;
        let elapsed = self.time.map_or(nominal, |last| time - last);
        self.time = Some(time);
        if !(elapsed > 0.0 && elapsed < LONGEST_GAP.max(LONGEST_TICK * nominal)) {
            events.raise(Event::ClockJump);
            return nominal;
        }
        elapsed.clamp(SHORTEST_TICK * nominal, LONGEST_TICK * nominal)
    }

    /// Checks and smooths a reading. Returns the state of the device to use, and whether the reading was accepted.
    fn feel_for(&mut self, reading: &Result<Reading, Fault>, period: f64, events: &mut Events) -> (RigidState, bool) {
        let has_faded = self.gain.value() == 0.0;
        let sensed = self.sense.take(reading, period, has_faded, events);
        if sensed.is_first {
            self.home = sensed.state.position;
        }
        if sensed.has_jumped {
            self.passivity.jump();
        }
        if sensed.is_well {
            self.passivity.observe(&sensed.state);
        }
        self.sensed = sensed.state;
        let goes_on = sensed.is_well && !sensed.is_first && !sensed.has_jumped;
        (if goes_on { self.smooth(sensed.state, period) } else { sensed.state }, sensed.is_well)
    }

    /// Smooths the device's state for the coupling by an alpha-beta filter, because stiffness and damping turn each
    /// encoder step into a jump of the force. The filter does not lag behind a device that moves at constant velocity.
    fn smooth(&mut self, device: RigidState, period: f64) -> RigidState {
        let (stiffness, damping) = self.tool.coupling.map_or((0.0, 0.0), |c| (c.stiffness, c.damping));
        // Share of an encoder step that passes the filter, so that a stiffness (here `gain`, N/m) turns this share into
        // a force change of at most [`SMOOTHED_STEP`].
        let step = self.settings.resolution.max(f64::MIN_POSITIVE);
        let share = |gain: f64| (SMOOTHED_STEP / (gain * step)).clamp(period / (period + LONGEST_SMOOTHING), 1.0);
        let (of_position, of_velocity) = (share(stiffness), share(damping / period));
        let last = self.device;
        let velocity = last.velocity.lerp(device.velocity, of_velocity);
        let angular_velocity = last.angular_velocity.lerp(device.angular_velocity, of_velocity);
        let foreseen = last.position + period * velocity;
        RigidState { position: foreseen.lerp(device.position, of_position), velocity, angular_velocity, ..device }
    }

    /// Takes the wrench `newest` if it is new and finite.
    fn take(&mut self, newest: &ContactWrench, time: f64, events: &mut Events) {
        if newest.step == self.contact.newest().step {
            return;
        }
        if !newest.is_finite() {
            events.raise(Event::BadWrench);
            return;
        }
        self.contact.take(newest, time, &self.tool.state(), self.passivity.energy().lent);
    }

    /// Moves the tool by one implicit Euler step under the coupling's pull and the contact; returns the contact wrench
    /// on the tool.
    fn move_tool(&mut self, device: &RigidState, h: f64, events: &mut Events) -> Wrench {
        let (state, gain) = (self.tool.state(), self.gain.value());
        if self.contact.advance(&state, h, gain, self.stored(device), &mut self.passivity) {
            events.raise(Event::Unpaid);
        }
        let evaluated = self.contact.evaluate(&state);
        if evaluated.is_beyond {
            events.raise(Event::BeyondTrust);
        }
        let contact = evaluated.tangent;
        let rows = self.tool.rows(h, DVec3::ZERO, &self.within_reach(device));
        let twist = vector(self.tool.velocity, self.tool.angular_velocity);
        let matrix = Matrix6::from_fn(|i, k| rows.matrix[i][k]) + h * (contact.damping + h * contact.stiffness);
        let rhs = Vector6::from(rows.rhs) + h * (contact.force - h * (contact.stiffness * twist));
        let change = matrix.cholesky().map(|factor| factor.solve(&rhs));
        let Some(change) = change.filter(|change| change.iter().all(|x| x.is_finite())) else {
            events.raise(Event::BadForce);
            self.still_at(&state);
            return Wrench::ZERO;
        };
        self.tool.advance(h, change.into());
        if !self.tool.state().is_valid() {
            events.raise(Event::BadForce);
            self.still_at(&state);
            return Wrench::ZERO;
        }
        let force = contact.force - h * (contact.stiffness * (twist + change)) - contact.damping * change;
        wrench(&force)
    }

    /// Sets the tool back to a given pose, at rest.
    fn still_at(&mut self, state: &RigidState) {
        (self.tool.centre, self.tool.orientation) = (state.position, state.orientation);
        (self.tool.velocity, self.tool.angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
    }

    /// The device's state with a position so close to the tool that the coupling's spring pulls no harder than the
    /// force limit.
    fn within_reach(&self, device: &RigidState) -> RigidState {
        self.tool.within_reach(device, self.settings.limits.force)
    }

    /// Energy stored in the coupling and in the tool's motion, J.
    fn stored(&self, device: &RigidState) -> f64 {
        self.tool.stored(device, self.settings.limits.force, self.settings.limits.torque > 0.0)
    }

    /// Whether the coupling's pull is so small that the force need not rise slowly.
    fn pulls_little(&self, device: &RigidState) -> bool {
        let Limits { force, torque, .. } = self.settings.limits;
        let pull = self.tool.pull(device);
        pull.force.length() <= NOTHING_TO_FADE * force
            && (torque == 0.0 || pull.torque.length() <= NOTHING_TO_FADE * torque)
    }

    /// Updates the energy balance for a change of the gain, which scales all stored energy. If the gain has risen,
    /// energy that the hand has not supplied is lent; if it has fallen, the energy that vanished repays loans. When
    /// contact has ended, the budget keeps only the energy in coupling and tool.
    fn book(&mut self, device: &RigidState) {
        let gain = self.gain.value();
        let risen = gain - std::mem::replace(&mut self.last_gain, gain);
        let contact = self.contact.evaluate(&self.tool.state());
        let stored = self.stored(device) + contact.stored;
        if risen > 0.0 {
            let missing = -self.passivity.surplus(gain * stored);
            // Beyond a certain stretch the coupling's pull is limited (see `within_reach`), so the energy stored by a
            // further stretch was never felt and is not lent.
            let near = self.tool.stored(&self.within_reach(device), f64::INFINITY, self.settings.limits.torque > 0.0);
            self.passivity.lend(missing.min(risen * (near + contact.stored)));
        } else if risen < 0.0 {
            if gain - risen == 1.0 {
                self.passivity.begin_to_fade();
            }
            self.passivity.repay(-risen * stored);
        }
        if self.felt == Wrench::ZERO && self.contact.newest().wrench == Wrench::ZERO {
            self.passivity.end_contact(gain * stored);
            self.contact.end();
        }
        self.passivity.note_stored(gain * stored);
    }

    /// Determines the wrench that is played: the reaction of the coupling's pull on the tool, times the gain, reduced
    /// by passivity control and safety limits. Returns this wrench, and the damping that was injected (N s/m).
    fn play(&mut self, device: &RigidState, h: f64, events: &mut Events) -> (Wrench, f64) {
        let pull = self.tool.pull(&self.within_reach(device));
        let gain = self.gain.value();
        self.book(device);
        let plays_torque = self.settings.limits.torque > 0.0;
        let torque = if plays_torque { -gain * pull.torque } else { DVec3::ZERO };
        let wanted = Wrench { force: -gain * pull.force, torque };
        let control = self.passivity.control(wanted, &self.sensed, h, gain);
        if control.wrench != wanted {
            events.raise(Event::Damped);
        }
        if control.is_limited {
            events.raise(Event::DampingLimited);
        }
        let played = match events.has_any(&[Event::DeviceLost, Event::BadForce]) {
            true => self.guard.cut(),
            false => self.guard.pass(control.wrench, h, events),
        };
        self.played = played;
        self.passivity.play(played);
        (played, control.damping)
    }
}

fn wrench(v: &Vector6<f64>) -> Wrench {
    Wrench { force: DVec3::new(v[0], v[1], v[2]), torque: DVec3::new(v[3], v[4], v[5]) }
}
