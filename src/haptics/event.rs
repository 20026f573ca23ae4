//! What happened in a tick that the user must hear of: the one place that gives each event its bit and its name.

use serde::{Deserialize, Serialize};

/// Something out of the ordinary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Event {
    /// The device could not be read or written; nothing is played.
    DeviceLost,
    /// The device's reading was not finite, or no rotation; the last one that was right is held.
    BadReading,
    /// The device leapt faster than a hand can move; its last pose is held until the force has faded.
    PoseJump,
    /// The device is beyond its workspace; the force fades.
    OutsideWorkspace,
    /// The newest wrench is older than the watchdog allows; the force fades.
    StaleWrench,
    /// A wrench was not finite, and was not taken.
    BadWrench,
    /// The clock stood still, ran backwards or leapt; the force starts again from zero.
    ClockJump,
    /// The tick came more than 2 ms after it was due.
    LateTick,
    /// The force rises from zero: at the start, and after what made it fade.
    Engaging,
    /// The tool left the neighbourhood in which the local model is trusted; the force does not grow further.
    BeyondTrust,
    /// Passivity control damped.
    Damped,
    /// Passivity control wanted more damping than the device allows.
    DampingLimited,
    /// The force or the torque was larger than the limit, and was shortened to it.
    Clamped,
    /// The force or the torque changed faster than the limit, and was held back.
    SlewLimited,
    /// What was to be played was not finite; nothing was.
    BadForce,
    /// Ticks before this one are missing from the recording.
    RecordLost,
    /// The newest wrench is followed more slowly: it holds more energy than the hand has given.
    Unpaid,
}

impl Event {
    /// Every event and its name, by rising bit.
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

/// A set of events.
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

    /// Whether any of several is in the set.
    pub fn has_any(self, events: &[Event]) -> bool {
        events.iter().any(|event| self.has(*event))
    }

    /// Names, by rising bit.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Event::ALL.into_iter().filter(move |(event, _)| self.has(*event)).map(|(_, name)| name)
    }
}

/// Counts events as they begin and as they last.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EventCounts {
    last: Events,
    /// How often each began, and in how many ticks it was there, in the order of [`Event::ALL`].
    counts: [(u64, u64); Event::ALL.len()],
}

impl EventCounts {
    /// Takes a tick's events; gives back those that began with it.
    pub fn add(&mut self, events: Events) -> Events {
        let begun = Events(events.0 & !self.last.0);
        for (k, (event, _)) in Event::ALL.into_iter().enumerate() {
            self.counts[k].0 += u64::from(begun.has(event));
            self.counts[k].1 += u64::from(events.has(event));
        }
        self.last = events;
        begun
    }

    /// Of every event that happened: its name, how often it began, and in how many ticks it was there.
    pub fn happened(&self) -> impl Iterator<Item = (&'static str, u64, u64)> {
        let all = Event::ALL.into_iter().zip(self.counts);
        all.filter(|(_, (begun, _))| *begun > 0).map(|((_, name), (begun, ticks))| (name, begun, ticks))
    }

    /// How often an event began.
    pub fn begun(&self, event: Event) -> u64 {
        self.counts[event as usize].0
    }

    /// In how many ticks it was there.
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
