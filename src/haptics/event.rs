//! Unusual events that a tick (one iteration of the haptic loop) may raise, which are recorded and reported to the
//! user. Each event's bit and name are defined here only. The force *played* is the force commanded to the haptic
//! device; the *newest wrench* is the contact wrench on the tool (the rigid body that the device leads) that the last
//! finished simulation step gave back.

use serde::{Deserialize, Serialize};

/// Something unusual that happened in a tick. The discriminant is the event's bit in [`Events`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Event {
    /// The haptic device could not be read or written; no force is played.
    DeviceLost,
    /// The device's reading was not finite or its orientation was no rotation; the last valid pose is used instead.
    BadReading,
    /// The device's pose leapt further than a hand can move in a tick; the last valid pose is used until the force has
    /// faded.
    PoseJump,
    /// The device is beyond its workspace; the force fades.
    OutsideWorkspace,
    /// The newest wrench is out of date by more than the time limit (watchdog); the force fades.
    StaleWrench,
    /// A wrench from the simulation was not finite and was ignored.
    BadWrench,
    /// The loop's clock stood still, ran backwards or leapt; the force starts again from zero.
    ClockJump,
    /// The tick came more than 2 ms after it was due.
    LateTick,
    /// The force is rising from zero, at the start or after something made the force fade.
    Engaging,
    /// The tool left the neighbourhood in which the local contact model (the linear force law of the newest wrench) is
    /// trusted; the force does not grow further.
    BeyondTrust,
    /// The passivity controller damped the force.
    Damped,
    /// The passivity controller wanted more damping than the device can render stably.
    DampingLimited,
    /// The force or the torque exceeded its limit and was shortened to it.
    Clamped,
    /// The force or the torque changed faster than its slew limit (greatest rate of change) allows and was
    /// held back.
    SlewLimited,
    /// The wrench to be played was not finite; none was played.
    BadForce,
    /// The ticks directly before this tick are missing from the file to which the loop's ticks are recorded.
    RecordLost,
    /// The local contact model of the newest wrench is blended in more slowly, because the model stores more energy
    /// than the hand has supplied.
    Unpaid,
}

impl Event {
    /// Every event with its name, by ascending bit.
    pub const ALL: [(Event, &'static str); 17] = [
        (Event::DeviceLost, "device_lost"),
        (Event::BadReading, "bad_reading"),
        (Event::PoseJump, "pose_jump"),
        (Event::OutsideWorkspace, "outside_workspace"),
        (Event::StaleWrench, "stale_wrench"),
        (Event::BadWrench, "bad_wrench"),
        (Event::ClockJump, "clock_jump"),
        (Event::LateTick, "late_tick"),
        (Event::Engaging, "engaging"),
        (Event::BeyondTrust, "beyond_trust"),
        (Event::Damped, "damped"),
        (Event::DampingLimited, "damping_limited"),
        (Event::Clamped, "clamped"),
        (Event::SlewLimited, "slew_limited"),
        (Event::BadForce, "bad_force"),
        (Event::RecordLost, "record_lost"),
        (Event::Unpaid, "unpaid"),
    ];
}

/// A set of events, one bit each.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Events(pub u32);

impl Events {
    /// Adds an event.
    pub fn raise(&mut self, event: Event) {
        self.0 |= 1 << event as u32;
    }

    /// Whether an event is in the set.
    pub fn has(self, event: Event) -> bool {
        self.0 >> event as u32 & 1 == 1
    }

    /// Whether at least one of several events is in the set.
    pub fn has_any(self, events: &[Event]) -> bool {
        events.iter().any(|event| self.has(*event))
    }

    /// The names of the events in the set, by ascending bit.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Event::ALL.into_iter().filter(move |(event, _)| self.has(*event)).map(|(_, name)| name)
    }
}

/// Counts, for each event, how often it began and how many ticks it lasted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EventCounts {
    last: Events,
    /// For each event, in the order of [`Event::ALL`]: how often it began, and the number of ticks in which it was
    /// present.
    counts: [(u64, u64); Event::ALL.len()],
}

impl EventCounts {
    /// Adds the events of a tick; returns the events that the tick before did not have.
    pub fn add(&mut self, events: Events) -> Events {
        let begun = Events(events.0 & !self.last.0);
        for (k, (event, _)) in Event::ALL.into_iter().enumerate() {
            self.counts[k].0 += u64::from(begun.has(event));
            self.counts[k].1 += u64::from(events.has(event));
        }
        self.last = events;
        begun
    }

    /// For each event that happened: its name, how often it began, and the number of ticks in which it was present.
    pub fn happened(&self) -> impl Iterator<Item = (&'static str, u64, u64)> {
        let all = Event::ALL.into_iter().zip(self.counts);
        all.filter(|(_, (begun, _))| *begun > 0).map(|((_, name), (begun, ticks))| (name, begun, ticks))
    }

    /// How often an event began.
    pub fn begun(&self, event: Event) -> u64 {
        self.counts[event as usize].0
    }

    /// Number of ticks in which an event was present.
    pub fn ticks(&self, event: Event) -> u64 {
        self.counts[event as usize].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_follow_the_table_and_beginnings_are_told_from_lasting() {
        for (k, (event, _)) in Event::ALL.into_iter().enumerate() {
            assert_eq!(event as usize, k);
        }
        let (mut none, mut stale) = (EventCounts::default(), Events::default());
        stale.raise(Event::StaleWrench);
        assert_eq!(none.add(stale).names().collect::<Vec<_>>(), ["stale_wrench"]);
        assert_eq!(none.add(stale), Events::default());
        none.add(Events::default());
        none.add(stale);
        assert_eq!(none.happened().collect::<Vec<_>>(), [("stale_wrench", 2, 3)]);
    }
}
