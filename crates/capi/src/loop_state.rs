//! State of a haptic loop, published by the loop's thread for other threads to read, while the loop runs and
//! afterwards. At each tick (one iteration) the loop reads the haptic device and plays a force, that is, commands the
//! device to exert it. Meanwhile the simulation does steps, each of which gives a new wrench: contact force and torque
//! on the tool, the rigid body that the device leads. Between two wrenches the contact force follows the tool's motion
//! by a local model, which consists of the force, stiffness and damping of the newest step.

use std::sync::{Condvar, Mutex, MutexGuard};

use palpate::RigidState;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{Moment, Report};

use super::simulation::palpate_pose;
use super::sized::{Field, Sized32, fields};
use super::status::{Failure, Outcome, palpate_status};
use super::steps::Newest;

/// Event of a tick (one iteration of the haptic loop): the haptic device could not be read or written; no force is
/// played on it.
pub const PALPATE_EVENT_DEVICE_LOST: u32 = 1;
/// Event of a tick: a number in the device's reading was not finite, or its orientation was no rotation; the last valid
/// pose is used instead.
pub const PALPATE_EVENT_BAD_READING: u32 = 2;
/// Event of a tick: the device's pose jumped further than a hand can move in a tick; the last valid pose is used until
/// the force has faded out.
pub const PALPATE_EVENT_POSE_JUMP: u32 = 4;
/// Event of a tick: the device is outside its workspace; the force fades out.
pub const PALPATE_EVENT_OUTSIDE_WORKSPACE: u32 = 8;
/// Event of a tick: the latency of the newest wrench is above the limit `watchdog` (see palpate_loop_options); the
/// force fades out.
pub const PALPATE_EVENT_STALE_WRENCH: u32 = 16;
/// Event of a tick: a wrench of the simulation was not finite, and was ignored.
pub const PALPATE_EVENT_BAD_WRENCH: u32 = 32;
/// Event of a tick: the clock stood still, ran backwards or jumped ahead; the force rises again from zero.
pub const PALPATE_EVENT_CLOCK_JUMP: u32 = 64;
/// Event of a tick: the tick began more than 2 ms after its deadline.
pub const PALPATE_EVENT_LATE_TICK: u32 = 128;
/// Event of a tick: only a part of the force is played, because the force is fading in (at the start of the loop, or
/// after a fade-out) or fading out.
pub const PALPATE_EVENT_ENGAGING: u32 = 256;
/// Event of a tick: the tool moved so far from its pose in the newest wrench that the local model (which extrapolates
/// the contact force from that pose) is no longer trusted; the contact force does not grow further.
pub const PALPATE_EVENT_BEYOND_TRUST: u32 = 512;
/// Event of a tick: the passivity controller (see palpate_loop_options) damped the force.
pub const PALPATE_EVENT_DAMPED: u32 = 1024;
/// Event of a tick: the passivity controller wanted more damping than the haptic device can play stably.
pub const PALPATE_EVENT_DAMPING_LIMITED: u32 = 2048;
/// Event of a tick: the force or the torque exceeded its limit, and was reduced to that limit.
pub const PALPATE_EVENT_CLAMPED: u32 = 4096;
/// Event of a tick: the force or the torque changed faster than the limit on its rate of change allows, so only a part
/// of the change was played.
pub const PALPATE_EVENT_SLEW_LIMITED: u32 = 8192;
/// Event of a tick: the force to be played was not finite; no force was played.
pub const PALPATE_EVENT_BAD_FORCE: u32 = 16384;
/// Event of a tick: the ticks directly before this one were not reported, because a step of the simulation took so long
/// that the buffer of ticks overflowed.
pub const PALPATE_EVENT_RECORD_LOST: u32 = 32768;
/// Event of a tick: the contact force changes to that of the newest wrench more slowly than usual, because the contact
/// of that wrench stores more energy than the user's hand has supplied.
pub const PALPATE_EVENT_UNPAID: u32 = 65536;

/// Number of ticks from one update of `late_p99`, the 99th percentile of the lateness of ticks, to the next. Updates
/// are rare, because each update searches a whole histogram.
const QUANTILE_EVERY: u64 = 1000;

/// State of a haptic loop; where several devices lead tools, that of one of them. It is updated after each step of the
/// simulation, so its values about ticks are at most one step old. Before the first tick all fields are zero, except
/// `size`, `is_running`, `notes`, `steps`, and the orientations of the poses, which are the identity.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_loop_state {
    /// Size of the struct in bytes: sizeof(palpate_loop_state).
    pub size: u32,
    /// 1: the loop runs; 0: the loop has ended, and the haptic device is closed.
    pub is_running: u32,
    /// Status with which the loop failed; PALPATE_STATUS_OK if it has not failed. A haptic device that is lost (cannot
    /// be read or written) for 5 s, of several all of them, ends the loop, but this is no failure.
    pub status: palpate_status,
    /// Number of notes (lines of text about the loop) that `palpate_loop_note` can read.
    pub notes: u32,
    /// Events of the newest tick: PALPATE_EVENT_*, one bit each.
    pub events: u32,
    /// All events that any tick has had so far: PALPATE_EVENT_*, one bit each.
    pub events_so_far: u32,
    /// Buttons of the haptic device, one bit each; 1: pressed.
    pub buttons: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// Number of ticks done.
    pub ticks: u64,
    /// Number of steps that the simulation has done for the loop, including those before the first tick.
    pub steps: u64,
    /// The simulation step whose wrench the newest tick used: number of that step, as `step` in palpate_wrench; 0:
    /// there is no wrench yet.
    pub wrench_step: u64,
    /// Number of deadlines of ticks that were missed by more than 2 ms.
    pub missed: u64,
    /// Time at which the newest tick began, s since the loop began.
    pub time: f64,
    /// Latency, at the newest tick, of the wrench that it used: time since the inputs of the wrench's step were taken,
    /// s.
    pub wrench_age: f64,
    /// Pose of the haptic device at the newest tick, as the loop uses it, that is, checked and smoothed.
    pub device: palpate_pose,
    /// Pose of the tool at the newest tick. The tool follows the haptic device by the virtual coupling, a spring and
    /// damper.
    pub tool: palpate_pose,
    /// Contact force on the tool at the newest tick, from the local model, N.
    pub contact_force: [f64; 3],
    /// Contact torque on the tool about its centre at the newest tick, from the local model, N m.
    pub contact_torque: [f64; 3],
    /// Force that the haptic device was last commanded to play, N.
    pub played_force: [f64; 3],
    /// Torque that the haptic device was last commanded to play, N m.
    pub played_torque: [f64; 3],
    /// Share of the force that is played, from 0 (faded out) to 1 (the whole force).
    pub gain: f64,
    /// Greatest magnitude so far of the force that was played, N.
    pub peak_force: f64,
    /// 99th percentile of the lateness of ticks (time from a tick's deadline to its beginning), s. It is updated every
    /// 1000 ticks and at the end of the loop.
    pub late_p99: f64,
    /// Greatest lateness of a tick so far, s.
    pub late_worst: f64,
}

// SAFETY: the struct is `repr(C)`, and its first field is its size. Some bytes are no value of the enum `status`; but
// the library only writes this struct to a caller's memory, and never reads it from there.
unsafe impl Sized32 for palpate_loop_state {
    const NAME: &str = "palpate_loop_state";
    const LEAST: usize = 320;
    const FIELDS: &'static [Field] = fields!(palpate_loop_state {
        size,
        is_running,
        status,
        notes,
        events,
        events_so_far,
        buttons,
        reserved,
        ticks,
        steps,
        wrench_step,
        missed,
        time,
        wrench_age,
        device,
        tool,
        contact_force,
        contact_torque,
        played_force,
        played_torque,
        gain,
        peak_force,
        late_p99,
        late_worst
    });

    fn unset() -> Self {
        let pose = palpate_pose { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] };
        palpate_loop_state {
            size: size_of::<Self>() as u32,
            is_running: 1,
            status: palpate_status::Ok,
            notes: 0,
            events: 0,
            events_so_far: 0,
            buttons: 0,
            reserved: 0,
            ticks: 0,
            steps: 0,
            wrench_step: 0,
            missed: 0,
            time: 0.0,
            wrench_age: 0.0,
            device: pose,
            tool: pose,
            contact_force: [0.0; 3],
            contact_torque: [0.0; 3],
            played_force: [0.0; 3],
            played_torque: [0.0; 3],
            gain: 0.0,
            peak_force: 0.0,
            late_p99: 0.0,
            late_worst: 0.0,
        }
    }
}

/// State of a loop that its thread shares with the threads that read it; only the loop's thread writes it.
pub(super) struct Told {
    told: Mutex<Facts>,
    changed: Condvar,
}

pub(super) struct Facts {
    /// The tools that devices lead, in the scene's order.
    pub led: Vec<Led>,
    pub notes: Vec<String>,
    /// Why the loop ended; empty while the loop runs.
    pub ended: String,
    pub failure: Option<Failure>,
    /// Whether the haptic devices have been opened.
    has_begun: bool,
}

/// What is told of a tool that a device leads.
pub(super) struct Led {
    pub state: palpate_loop_state,
    pub newest: Newest,
    lateness: Lateness,
    /// Time from the deadline of one tick to that of the next, s.
    period: f64,
}

impl Led {
    fn new(period: f64) -> Led {
        let lateness = Lateness::new();
        Led { state: palpate_loop_state::unset(), newest: Newest::NONE, lateness, period }
    }

    fn tick(&mut self, tick: &Tick) {
        let pose = |state: &RigidState| palpate_pose {
            position: state.position.to_array(),
            orientation: state.orientation.to_array(),
        };
        self.lateness.add(tick.late, self.period);
        let state = &mut self.state;
        state.events = tick.events.0;
        state.events_so_far |= tick.events.0;
        state.buttons = tick.reading.map_or(state.buttons, |reading| reading.buttons);
        state.ticks = tick.index + 1;
        (state.wrench_step, state.wrench_age) = (tick.step, tick.staleness);
        (state.time, state.gain) = (tick.time, tick.gain);
        (state.device, state.tool) = (pose(&tick.device), pose(&tick.tool));
        (state.contact_force, state.contact_torque) = (tick.contact.force.to_array(), tick.contact.torque.to_array());
        (state.played_force, state.played_torque) = (tick.played.force.to_array(), tick.played.torque.to_array());
        state.peak_force = state.peak_force.max(tick.played.force.length());
        (state.missed, state.late_worst) = (self.lateness.missed(), self.lateness.worst());
        if self.lateness.ticks().is_multiple_of(QUANTILE_EVERY) {
            state.late_p99 = self.lateness.quantile(0.99);
        }
    }
}

impl Facts {
    fn is_running(&self) -> bool {
        self.led.iter().any(|led| led.state.is_running == 1)
    }

    /// The state of every tool.
    fn states(&mut self) -> impl Iterator<Item = &mut palpate_loop_state> {
        self.led.iter_mut().map(|led| &mut led.state)
    }
}

impl Told {
    /// Makes the state of a loop that has not begun. `periods`: for each device the time from the deadline of one of its
    /// ticks to that of the next, s.
    pub fn new(periods: impl Iterator<Item = f64>) -> Told {
        let facts = Facts {
            led: periods.map(Led::new).collect(),
            notes: Vec::new(),
            ended: String::new(),
            failure: None,
            has_begun: false,
        };
        Told { told: Mutex::new(facts), changed: Condvar::new() }
    }

    /// Locks the state. Release the lock soon, because the loop's thread waits for it.
    pub fn lock(&self) -> MutexGuard<'_, Facts> {
        // A panic cannot leave the state half-changed: the state is consistent between any two statements under the
        // lock.
        self.told.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Updates the state by a report of the running loop, which is a session of the engine: its beginning, a step, a
    /// tick or a note.
    pub fn hear(&self, moment: Moment) {
        let mut facts = self.lock();
        match moment {
            Moment::Begin(..) => {}
            Moment::Step(..) => facts.states().for_each(|state| state.steps += 1),
            Moment::Tick(index, tick) => facts.led[index].tick(tick),
            Moment::Note(note) => {
                facts.notes.push(note.into());
                let count = facts.notes.len() as u32;
                facts.states().for_each(|state| state.notes = count);
                // The session reports its first note when the haptic devices are open and the loops run.
                facts.has_begun = true;
                self.changed.notify_all();
            }
        }
    }

    /// Stores the wrenches of the newest step, one for each tool.
    pub fn note(&self, newest: impl Iterator<Item = Newest>) {
        self.lock().led.iter_mut().zip(newest).for_each(|(led, newest)| led.newest = newest);
    }

    /// Records how the loop ended, and wakes the threads that wait for the loop to begin (`wait_for_begin`).
    pub fn end(&self, came: Outcome<Vec<Report>>) {
        let mut facts = self.lock();
        for led in &mut facts.led {
            led.state.is_running = 0;
            led.state.late_p99 = led.lateness.quantile(0.99);
        }
        match came {
            Ok(reports) => {
                let early = reports.into_iter().find_map(|report| report.ended);
                facts.ended = early.unwrap_or_else(|| "its duration is over".into());
            }
            Err(failure) => {
                facts.states().for_each(|state| state.status = failure.status);
                facts.ended = failure.message.clone();
                facts.failure = Some(failure);
            }
        }
        self.changed.notify_all();
    }

    /// Waits until the haptic devices are open or the loop has ended. Errors: why the loop failed before the devices
    /// were open.
    pub fn wait_for_begin(&self) -> Outcome {
        let mut facts = self.lock();
        while !facts.has_begun && facts.is_running() {
            facts = self.changed.wait(facts).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
        match (&facts.failure, facts.has_begun) {
            (Some(failure), false) => Err(failure.clone()),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use palpate::internal::haptics::event::{Event, Events};

    use super::*;

    #[test]
    fn every_event_has_its_constant() {
        let own = [
            PALPATE_EVENT_DEVICE_LOST,
            PALPATE_EVENT_BAD_READING,
            PALPATE_EVENT_POSE_JUMP,
            PALPATE_EVENT_OUTSIDE_WORKSPACE,
            PALPATE_EVENT_STALE_WRENCH,
            PALPATE_EVENT_BAD_WRENCH,
            PALPATE_EVENT_CLOCK_JUMP,
            PALPATE_EVENT_LATE_TICK,
            PALPATE_EVENT_ENGAGING,
            PALPATE_EVENT_BEYOND_TRUST,
            PALPATE_EVENT_DAMPED,
            PALPATE_EVENT_DAMPING_LIMITED,
            PALPATE_EVENT_CLAMPED,
            PALPATE_EVENT_SLEW_LIMITED,
            PALPATE_EVENT_BAD_FORCE,
            PALPATE_EVENT_RECORD_LOST,
            PALPATE_EVENT_UNPAID,
        ];
        let bit = |(event, _)| {
            let mut events = Events::default();
            events.raise(event);
            events.0
        };
        assert_eq!(Event::ALL.map(bit), own);
    }

    #[test]
    fn a_loop_that_fails_says_so_to_whoever_waits_for_its_beginning_and_to_all_afterwards() {
        let failed = || Err(Failure::new(palpate_status::Vulkan, "the device is on fire"));
        let told = Told::new([1e-3; 2].into_iter());
        told.end(failed());
        assert_eq!(told.wait_for_begin().unwrap_err().message, "the device is on fire");
        let facts = told.lock();
        for Led { state, .. } in &facts.led {
            assert_eq!((state.is_running, state.status), (0, palpate_status::Vulkan));
        }
        assert_eq!(facts.ended, "the device is on fire");
        let began = Told::new([1e-3; 2].into_iter());
        began.hear(Moment::Note("a note"));
        assert!(began.wait_for_begin().is_ok() && began.lock().led[1].state.is_running == 1);
        began.end(failed());
        assert!(began.wait_for_begin().is_ok() && began.lock().failure.is_some());
    }

    #[test]
    fn the_state_is_as_long_as_its_first_version() {
        assert_eq!(size_of::<palpate_loop_state>(), palpate_loop_state::LEAST);
    }
}
