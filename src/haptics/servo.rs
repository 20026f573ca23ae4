//! One tick of the loop, from a reading to what is played: no clock, no thread, no allocation, and the same bits for the
//! same inputs.
//!
//! The tool follows the device by virtual coupling and feels contact by the local model of the newest wrench. What the
//! coupling pulls the tool with, the hand feels.

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
use crate::step::{ContactWrench, Held, RigidState, Wrench};

/// A tick is late from here on, s.
const LATE: f64 = 2e-3;
/// Periods that a tick may integrate over at most, whatever the clock says.
const LONGEST_TICK: f64 = 4.0;
/// A coarse encoder's step, m.
const ENCODER_STEP: f64 = 2e-5;
/// What such a step may change the force by, through the coupling's stiffness and through its damping, N.
const STEP_FORCE: f64 = 0.02;
/// The device is smoothed over this time at most, s: smoothing is delay, and delay costs stability.
const LONGEST_SMOOTHING: f64 = 0.001;
/// Of the period, the least.
const SHORTEST_TICK: f64 = 0.25;
/// A clock that leaps further than this has jumped, s.
const LONGEST_GAP: f64 = 0.25;
/// A simulation that answers, but with what cannot be, is trusted no longer than this, s.
const LONGEST_BAD: f64 = 0.25;
/// A new wrench is blended in over the interval since the last one, but over this at most, s: for longer than that the tool would
/// lag behind a body that moves.
const LONGEST_BLEND: f64 = 0.02;
/// Without contact a force below this share of the limit is so small that there is nothing to fade.
const NOTHING_TO_FADE: f64 = 0.02;

/// What a servo is made with; with the readings and the wrenches it decides every bit of what is played.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Of a tick, s.
    pub period: f64,
    /// Of what is played.
    pub limits: Limits,
    /// Whether contact is followed between wrenches; else the force of the newest is kept as it is.
    pub local_model: bool,
    /// Whether the passivity controller acts; energy is observed in any case.
    pub passivity: bool,
    /// Greatest damping that it may inject, N s/m, and about any axis, N m s/rad.
    pub most_damping: [f64; 2],
    /// How far from its pose the local model is trusted, m.
    pub trust: f64,
    /// At which rotations of the tool count as displacements, m.
    pub arm: f64,
}

/// What a tick did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// From 0.
    pub index: u64,
    /// When it began, s on the loop's clock.
    pub time: f64,
    /// By how much it came after it was due, s.
    pub late: f64,
    /// What the device said; `None`: nothing that can be used.
    pub reading: Option<Reading>,
    /// The device as taken.
    pub device: RigidState,
    /// The tool at the end of the tick.
    pub tool: RigidState,
    /// Of contact on the tool, as the local model has it.
    pub contact: Wrench,
    /// What the hand is pushed with.
    pub played: Wrench,
    /// Steps of the simulation done by the newest wrench.
    pub step: u64,
    /// Of the newest wrench: time since its step's inputs were taken, s.
    pub age: f64,
    /// Share of the force that is played, from 0 to 1.
    pub gain: f64,
    /// Damping that passivity control took, N s/m.
    pub damping: f64,
    /// Observed so far.
    pub energy: Energy,
    /// What happened.
    pub events: Events,
}

/// The loop's state.
#[derive(Debug, Clone)]
pub struct Servo {
    settings: Settings,
    tool: Tool,
    sense: Sense,
    /// The device as read and believed, and smoothed.
    sensed: RigidState,
    device: RigidState,
    contact: Followed,
    /// What contact pushed the tool with in the last tick.
    felt: Wrench,
    gain: Gain,
    last_gain: f64,
    guard: Guard,
    passivity: Passivity,
    index: u64,
    time: Option<f64>,
    home: DVec3,
    played: Wrench,
}

impl Servo {
    /// A tool that rests where it is, coupled to a device that has not been read yet.
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
            passivity: Passivity::new(settings.passivity, !local_model, settings.most_damping),
            index: 0,
            time: None,
            home: start.position,
            played: Wrench::ZERO,
            settings,
            tool,
        }
    }

    /// One tick at `time` (s), `late` s after it was due: the device's reading in, what to play out. `newest` is the newest
    /// wrench there is, whether it was there before or not.
    pub fn tick(&mut self, time: f64, late: f64, reading: Result<Reading, Fault>, newest: &ContactWrench) -> Tick {
        let mut events = Events::default();
        let period = self.clock(time, late, &mut events);
        let (device, is_well) = self.feel_for(&reading, period, &mut events);
        self.take(newest, time, &mut events);
        let newest = self.contact.newest();
        let (step, age) = (newest.step, if newest.step > 0 { time - newest.time } else { 0.0 });
        // A wrench from the future tells as little as one that is old, or of no known age.
        let longest = match events.has(Event::BadWrench) {
            true => self.settings.limits.watchdog.min(LONGEST_BAD),
            false => self.settings.limits.watchdog,
        };
        if age.is_nan() || age.abs() > longest {
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
            age,
            gain: self.gain.value(),
            damping,
            energy: self.passivity.energy(),
            events,
        };
        self.index += 1;
        tick
    }

    /// What a step of the simulation starts from now.
    pub fn held(&self) -> Held {
        let time = self.time.unwrap_or(0.0);
        let coupling = self.tool.coupling.filter(|_| self.index > 0);
        let max_force = self.settings.limits.force;
        Held { ticks: self.index, time, device: self.device, tool: self.tool.state(), coupling, max_force }
    }

    /// The newest wrench.
    pub fn newest(&self) -> ContactWrench {
        *self.contact.newest()
    }

    /// Of a tick, s.
    pub fn period(&self) -> f64 {
        self.settings.period
    }

    /// The device did not take what was to be played: nothing is, and the force starts again from zero.
    pub fn unplayed(&mut self, tick: &mut Tick) {
        tick.events.raise(Event::DeviceLost);
        tick.played = self.guard.cut();
        self.played = tick.played;
        self.gain.cut();
        self.passivity.play(tick.played);
    }

    /// Time to integrate over, s.
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

    /// The device as it can be used, and whether all is well with it.
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

    /// The device as the coupling has it, by an alpha-beta filter: through stiffness and damping an encoder's steps are jumps of
    /// the force. It does not lag behind a device that moves evenly.
    fn smooth(&mut self, device: RigidState, period: f64) -> RigidState {
        let (stiffness, damping) = self.tool.coupling.map_or((0.0, 0.0), |c| (c.stiffness, c.damping));
        // Of what a step through a gain (N/m) would change the force by.
        let share = |gain: f64| (STEP_FORCE / (gain * ENCODER_STEP)).clamp(period / (period + LONGEST_SMOOTHING), 1.0);
        let (of_position, of_velocity) = (share(stiffness), share(damping / period));
        let last = self.device;
        let velocity = last.velocity.lerp(device.velocity, of_velocity);
        let angular_velocity = last.angular_velocity.lerp(device.angular_velocity, of_velocity);
        let foreseen = last.position + period * velocity;
        RigidState { position: foreseen.lerp(device.position, of_position), velocity, angular_velocity, ..device }
    }

    /// A wrench that is new becomes the newest.
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

    /// Moves the tool by implicit Euler: coupling towards the device as it is now, and contact.
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

    fn still_at(&mut self, state: &RigidState) {
        (self.tool.centre, self.tool.orientation) = (state.position, state.orientation);
        (self.tool.velocity, self.tool.angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
    }

    /// The device, drawn up to the tool so far that the coupling pulls no harder than may be played.
    fn within_reach(&self, device: &RigidState) -> RigidState {
        self.tool.within_reach(device, self.settings.limits.force)
    }

    /// What coupling and tool store, J.
    fn stored(&self, device: &RigidState) -> f64 {
        self.tool.stored(device, self.settings.limits.force, self.settings.limits.torque > 0.0)
    }

    /// Whether the coupling pulls so little that a force need not rise slowly.
    fn pulls_little(&self, device: &RigidState) -> bool {
        let Limits { force, torque, .. } = self.settings.limits;
        let pull = self.tool.pull(device);
        pull.force.length() <= NOTHING_TO_FADE * force
            && (torque == 0.0 || pull.torque.length() <= NOTHING_TO_FADE * torque)
    }

    /// Books what the share of the force that is played does to what is stored: a rise is lent as far as nobody has paid for it,
    /// a fall repays. Contact that has ended leaves nothing but what coupling and tool hold.
    fn book(&mut self, device: &RigidState) {
        let gain = self.gain.value();
        let risen = gain - std::mem::replace(&mut self.last_gain, gain);
        let contact = self.contact.evaluate(&self.tool.state());
        let stored = self.stored(device) + contact.stored;
        if risen > 0.0 {
            let missing = -self.passivity.surplus(gain * stored);
            // What lies beyond the coupling's reach was never felt.
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

    /// What the coupling pulls the tool with, the other way round; then what passivity and safety leave of it.
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
