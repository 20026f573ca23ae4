//! What a loop tells of itself while it runs, and afterwards.

use std::sync::{Condvar, Mutex, MutexGuard};

use palpate::RigidState;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{Moment, Report};

use super::simulation::palpate_pose;
use super::sized::{Field, Sized32, fields};
use super::status::{Failure, Outcome, palpate_status};
use super::steps::Newest;

/// The device could not be read or written; nothing is played.
pub const PALPATE_EVENT_DEVICE_LOST: u32 = 1;
/// The device's reading was not finite, or no rotation; the last one that was right is held.
pub const PALPATE_EVENT_BAD_READING: u32 = 2;
/// The device leapt faster than a hand can move; its last pose is held until the force has faded.
pub const PALPATE_EVENT_POSE_JUMP: u32 = 4;
/// The device is beyond its workspace; the force fades.
pub const PALPATE_EVENT_OUTSIDE_WORKSPACE: u32 = 8;
/// The newest wrench is older than the watchdog allows; the force fades.
pub const PALPATE_EVENT_STALE_WRENCH: u32 = 16;
/// A wrench was not finite, and was not taken.
pub const PALPATE_EVENT_BAD_WRENCH: u32 = 32;
/// The clock stood still, ran backwards or leapt; the force starts again from zero.
pub const PALPATE_EVENT_CLOCK_JUMP: u32 = 64;
/// The tick came more than 2 ms after it was due.
pub const PALPATE_EVENT_LATE_TICK: u32 = 128;
/// The force rises from zero: at the start, and after what made it fade.
pub const PALPATE_EVENT_ENGAGING: u32 = 256;
/// The tool left the neighbourhood in which the local model is trusted; the force does not grow further.
pub const PALPATE_EVENT_BEYOND_TRUST: u32 = 512;
/// Passivity control damped.
pub const PALPATE_EVENT_DAMPED: u32 = 1024;
/// Passivity control wanted more damping than the device allows.
pub const PALPATE_EVENT_DAMPING_LIMITED: u32 = 2048;
/// The force or the torque was larger than the limit, and was shortened to it.
pub const PALPATE_EVENT_CLAMPED: u32 = 4096;
/// The force or the torque changed faster than the limit, and was held back.
pub const PALPATE_EVENT_SLEW_LIMITED: u32 = 8192;
/// What was to be played was not finite; nothing was.
pub const PALPATE_EVENT_BAD_FORCE: u32 = 16384;
/// Ticks before this one were not heard of: the simulation's step took longer than there was room for.
pub const PALPATE_EVENT_RECORD_LOST: u32 = 32768;
/// The newest wrench is followed more slowly: it holds more energy than the hand has given.
pub const PALPATE_EVENT_UNPAID: u32 = 65536;

/// Ticks from one quantile of the lateness to the next: it looks through a histogram.
const QUANTILE_EVERY: u64 = 1000;

/// A loop as it was after the simulation's last step: what it says of ticks is no older than a step. Before the first tick
/// all of it is zero but `steps`, `is_running` and poses that turn nothing.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_loop_state {
    /// sizeof(palpate_loop_state).
    pub size: u32,
    /// 1: it runs; 0: it has ended, and the device is closed.
    pub is_running: u32,
    /// What it failed with; PALPATE_STATUS_OK where it did not, or has not yet. A device that stays lost ends
    /// the loop after 5 s, and is no failure.
    pub status: palpate_status,
    /// How many notes there are for `palpate_loop_note`.
    pub notes: u32,
    /// What happened in the newest tick: a bit each, PALPATE_EVENT_*.
    pub events: u32,
    /// What happened in any tick so far.
    pub events_so_far: u32,
    /// Buttons of the device, a bit each.
    pub buttons: u32,
    /// 0.
    pub reserved: u32,
    /// Ticks done.
    pub ticks: u64,
    /// Steps of the simulation done, those before the first tick included.
    pub steps: u64,
    /// Steps done by the wrench that the newest tick plays; 0: it has none yet.
    pub wrench_step: u64,
    /// Deadlines that were missed by more than 2 ms.
    pub missed: u64,
    /// When the newest tick began, s since the loop did.
    pub time: f64,
    /// At the newest tick: how long ago the inputs of its wrench were taken, s.
    pub wrench_age: f64,
    /// Where the device is taken to be.
    pub device: palpate_pose,
    /// Where the tool is, which follows it.
    pub tool: palpate_pose,
    /// Of contact on the tool, as the local model has it at the newest tick, N.
    pub contact_force: [f64; 3],
    /// The same, N m.
    pub contact_torque: [f64; 3],
    /// What the device was last told to play, N.
    pub played_force: [f64; 3],
    /// The same, N m.
    pub played_torque: [f64; 3],
    /// Share of the force that is played, from 0 to 1.
    pub gain: f64,
    /// Greatest force that was played, N.
    pub peak_force: f64,
    /// How late ticks came, s: what 99 of 100 stay within, brought up to date every 1000 ticks and at the end.
    pub late_p99: f64,
    /// The latest, s.
    pub late_worst: f64,
}

// SAFETY: `repr(C)`, the size comes first; all of it are numbers, and it is only written, never read.
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

/// What is known of a loop; written by its thread alone.
pub(super) struct Told {
    told: Mutex<Facts>,
    changed: Condvar,
}

pub(super) struct Facts {
    pub state: palpate_loop_state,
    pub newest: Newest,
    pub notes: Vec<String>,
    /// Why it ended; empty while it runs.
    pub ended: String,
    pub failure: Option<Failure>,
    lateness: Lateness,
    /// s.
    period: f64,
    /// Whether the device was opened.
    has_begun: bool,
}

impl Told {
    /// Before the beginning; `period`: s.
    pub fn new(period: f64) -> Told {
        let facts = Facts {
            state: palpate_loop_state::unset(),
            newest: Newest::NONE,
            notes: Vec::new(),
            ended: String::new(),
            failure: None,
            lateness: Lateness::new(),
            period,
            has_begun: false,
        };
        Told { told: Mutex::new(facts), changed: Condvar::new() }
    }

    /// Held for moments only.
    pub fn lock(&self) -> MutexGuard<'_, Facts> {
        // It is whole between any two of its statements.
        self.told.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Hears what a session records.
    pub fn hear(&self, moment: Moment) {
        let mut facts = self.lock();
        match moment {
            Moment::Begin(..) => {}
            Moment::Step(..) => facts.state.steps += 1,
            Moment::Tick(tick) => facts.tick(tick),
            Moment::Note(note) => {
                facts.notes.push(note.into());
                facts.state.notes = facts.notes.len() as u32;
                // The first of them comes once the device is open.
                facts.has_begun = true;
                self.changed.notify_all();
            }
        }
    }

    /// The wrench of a step.
    pub fn note(&self, newest: Newest) {
        self.lock().newest = newest;
    }

    /// It is over.
    pub fn end(&self, came: Outcome<Report>) {
        let mut facts = self.lock();
        facts.state.is_running = 0;
        facts.state.late_p99 = facts.lateness.quantile(0.99);
        match came {
            Ok(report) => facts.ended = report.ended.unwrap_or_else(|| "its time is over".into()),
            Err(failure) => {
                facts.state.status = failure.status;
                facts.ended = failure.message.clone();
                facts.failure = Some(failure);
            }
        }
        self.changed.notify_all();
    }

    /// Waits until the device is open; errors: why it never was.
    pub fn wait_for_begin(&self) -> Outcome {
        let mut facts = self.lock();
        while !facts.has_begun && facts.state.is_running == 1 {
            facts = self.changed.wait(facts).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
        match (&facts.failure, facts.has_begun) {
            (Some(failure), false) => Err(failure.clone()),
            _ => Ok(()),
        }
    }
}

impl Facts {
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
        (state.wrench_step, state.wrench_age) = (tick.step, tick.age);
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
        let told = Told::new(1e-3);
        told.end(failed());
        assert_eq!(told.wait_for_begin().unwrap_err().message, "the device is on fire");
        let facts = told.lock();
        assert_eq!((facts.state.is_running, facts.state.status), (0, palpate_status::Vulkan));
        assert_eq!(facts.ended, "the device is on fire");
        let began = Told::new(1e-3);
        began.hear(Moment::Note("a note"));
        assert!(began.wait_for_begin().is_ok() && began.lock().state.is_running == 1);
        began.end(failed());
        assert!(began.wait_for_begin().is_ok() && began.lock().failure.is_some());
    }

    #[test]
    fn the_state_is_as_long_as_its_first_version() {
        assert_eq!(size_of::<palpate_loop_state>(), palpate_loop_state::LEAST);
    }
}
