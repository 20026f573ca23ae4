//! Unusual events that a tick (one iteration of the haptic loop) may raise, which are recorded and reported to the
//! user. Each event's bit, name and explanation are defined here only. The force *played* is the force commanded to the
//! haptic device; the *tool* is the rigid body that the device leads; the *newest wrench* is the contact wrench (force
//! and torque) on the tool that the last finished simulation step gave back. The *passivity controller* damps the force
//! where the hand would otherwise receive more energy than it gave.

use serde::{Deserialize, Serialize};

use crate::stages::Explanation;

/// Something unusual that happened in a tick. The discriminant is the event's bit in [`Events`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Event {
    /// The haptic device could not be read or written; no force is played.
    DeviceLost,
    /// The device's reading was not finite or its orientation was no rotation; the last valid pose is used instead.
    BadReading,
    /// The device's pose changed by more than a hand can move in a tick; the last valid pose is used until the force
    /// has faded.
    PoseJump,
    /// The device is beyond its workspace; the force fades.
    OutsideWorkspace,
    /// The newest wrench is older than the scene's `haptics.watchdog` allows; the force fades.
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
    /// The force or the torque changed faster than its slew limit (greatest rate of change) allows and was held back.
    SlewLimited,
    /// The wrench to be played was not finite; no wrench was played.
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

    /// The explanation of each event to the user (title, meaning and remedy), in the order of [`Event::ALL`].
    const EXPLANATIONS: [Explanation; Event::ALL.len()] = [
        Explanation {
            title: "the device was lost",
            meaning: "The haptic device could not be read or written, and no force was played meanwhile.",
            remedy: Some("Check the cable, the device's power and its service."),
        },
        Explanation {
            title: "a bad reading of the device",
            meaning: "The device gave a pose that is not finite or whose orientation is no rotation. The last \
             valid pose was used instead.",
            remedy: Some("Check the device, its driver and its calibration."),
        },
        Explanation {
            title: "the device's pose jumped",
            meaning: "The pose changed by more than a hand can move between two readings. The last valid pose was used \
             until the force had faded.",
            remedy: Some("Check the device, its connection and its calibration."),
        },
        Explanation {
            title: "the device left its workspace",
            meaning: "The device was beyond the workspace of its profile, and the force faded there.",
            remedy: Some(
                "Move the body or the tool in the scene so that the touch lies within the device's workspace.",
            ),
        },
        Explanation {
            title: "the contact force was out of date",
            meaning: "The newest contact force was older than haptics.watchdog allows, so the force faded until a \
             newer one came.",
            remedy: Some("Make the scene cheaper, for example with larger cells, a coarser skin or preset = \"fast\"."),
        },
        Explanation {
            title: "a bad force from the simulation",
            meaning: "A contact force that the simulation computed was not finite and was ignored.",
            remedy: Some("See the flags of the steps, and shorten step.dt."),
        },
        Explanation {
            title: "the clock jumped",
            meaning: "The clock stood still, ran backwards or leapt, and the force started again from zero.",
            remedy: Some("Keep the computer from suspending, and do not set its clock, during a session."),
        },
        Explanation {
            title: "the loop was late",
            meaning: "An update of the force began more than 2 ms after it was due.",
            remedy: Some("Close other programs, or allow the program real-time scheduling."),
        },
        Explanation {
            title: "the force was fading in",
            meaning: "The force rose smoothly from zero, as it does at the start and after anything that made it \
             fade.",
            remedy: None,
        },
        Explanation {
            title: "the tool moved further than the last contact force can tell",
            meaning: "Between two steps of the simulation the tool left the neighbourhood in which the last contact \
             force and its stiffness are trusted, and the force did not grow further.",
            remedy: Some(
                "Make the scene cheaper, so that steps take less time, move more slowly, or raise \
             haptics.trust.",
            ),
        },
        Explanation {
            title: "the force was damped to stay stable",
            meaning: "The passivity controller damped or withheld the force, because the hand would otherwise have received \
             more energy than it gave.",
            remedy: None,
        },
        Explanation {
            title: "more damping was needed than the device can render",
            meaning: "The passivity controller needed more damping than the device can render stably, so the hand \
             may have received energy.",
            remedy: Some("Lower coupling.stiffness, or make the scene cheaper, so that steps take less time."),
        },
        Explanation {
            title: "the force was limited",
            meaning: "The force or the torque exceeded its limit and was shortened to it. What was felt is weaker \
             than what was computed.",
            remedy: Some(
                "Press less deep, soften the body or the coupling, or raise haptics.max_force or \
             haptics.max_torque if the device's profile allows more.",
            ),
        },
        Explanation {
            title: "the force was not allowed to change so fast",
            meaning: "The force or the torque changed faster than its slew limit allows and was held back.",
            remedy: Some(
                "Move more slowly, soften the coupling, or raise haptics.max_slew if the device's profile \
             allows more.",
            ),
        },
        Explanation {
            title: "a bad force to play",
            meaning: "The force that was to be played was not finite, and no force was played.",
            remedy: Some("See the flags of the steps, and shorten step.dt."),
        },
        Explanation {
            title: "part of the recording was lost",
            meaning: "Updates of the force directly before this one are missing from the recording and from the \
             statistics.",
            remedy: Some("Record onto a faster disk, or close other programs."),
        },
        Explanation {
            title: "a stiffer contact was felt late",
            meaning: "A new contact force stores more energy than the hand has supplied, so it was blended in more \
             slowly.",
            remedy: None,
        },
    ];

    /// The words that explain the event to a user.
    pub fn explained(self) -> &'static Explanation {
        &Event::EXPLANATIONS[self as usize]
    }

    /// The event that has this name.
    pub fn named(name: &str) -> Option<Event> {
        Event::ALL.into_iter().find(|(_, known)| *known == name).map(|(event, _)| event)
    }
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
    /// Adds the events of a tick; returns the events that began, which are those that the previous tick did not have.
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
    fn every_event_is_explained_and_no_two_alike() {
        let titles: std::collections::BTreeSet<_> =
            Event::ALL.iter().map(|(event, _)| event.explained().title).collect();
        assert_eq!(titles.len(), Event::ALL.len());
        for (event, name) in Event::ALL {
            let Explanation { title, meaning, remedy } = event.explained();
            assert!(
                !title.is_empty() && !title.ends_with('.') && meaning.ends_with('.'),
                "{name}: its title must not be empty or end with a full stop, and its meaning must end with one"
            );
            assert!(remedy.is_none_or(|remedy| remedy.ends_with('.')), "{name}: its remedy must end with a full stop");
            assert_eq!(Event::named(name), Some(event));
        }
        assert_eq!(Event::named("no_event"), None);
        assert_eq!(Event::LateTick.explained().title, "the loop was late");
        assert_eq!(Event::Unpaid.explained().title, "a stiffer contact was felt late");
    }

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
