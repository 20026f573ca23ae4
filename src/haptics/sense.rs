//! Plausibility check of the haptic device's readings: decides in each tick (iteration) of the haptic loop which pose
//! and twist (linear and angular velocity) of the device to use.

use super::device::{Fault, Reading};
use super::event::{Event, Events};
use crate::step::RigidState;
use crate::step::trajectory::rotation_vector;

/// Speed above which a reading is implausible, m/s: no hand moves a device faster.
const FASTEST: f64 = 5.0;
/// Angular speed above which a reading is implausible, rad/s: no hand turns a device faster.
const FASTEST_TURN: f64 = 60.0;

/// Checks readings and remembers the last valid one.
#[derive(Debug, Clone)]
pub struct Sense {
    last: RigidState,
    has_read: bool,
}

/// A checked reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// Pose and twist of the device; if the reading was rejected, the last valid pose with zero twist; if the pose is
    /// used but the velocity is implausible, the new pose with zero twist.
    pub state: RigidState,
    /// Whether this tick's reading was accepted as plausible.
    pub is_well: bool,
    /// Whether this is the first valid reading of all.
    pub is_first: bool,
    /// Whether the pose is used although it is implausibly far from the last valid pose.
    pub has_jumped: bool,
}

impl Sense {
    /// Begins with `start` as the device's state, which is used until the first valid reading.
    pub fn new(start: RigidState) -> Sense {
        Sense { last: start, has_read: false }
    }

    /// Checks a reading, taken `period` s after the last reading. A pose that leapt is used only if `has_faded`, that
    /// is, if the force commanded to the device has faded to zero; until then the last valid pose is used.
    pub fn take(
        &mut self,
        reading: &Result<Reading, Fault>,
        period: f64,
        has_faded: bool,
        events: &mut Events,
    ) -> Sensed {
        let held = RigidState::at_rest(self.last.position, self.last.orientation);
        let unwell = Sensed { state: held, is_well: false, is_first: false, has_jumped: false };
        let state = match reading {
            Err(Fault::Lost(_)) => {
                events.raise(Event::DeviceLost);
                return unwell;
            }
            Ok(reading) if reading.state.is_valid() => {
                RigidState { orientation: reading.state.orientation.normalize(), ..reading.state }
            }
            Ok(_) | Err(Fault::Garbled(_)) => {
                events.raise(Event::BadReading);
                return unwell;
            }
        };
        let turn = rotation_vector(state.orientation * self.last.orientation.conjugate()).length();
        let moved = (state.position - self.last.position).length();
        let too_fast = state.velocity.length() > FASTEST || state.angular_velocity.length() > FASTEST_TURN;
        let leapt = self.has_read && (moved > FASTEST * period || turn > FASTEST_TURN * period || too_fast);
        if leapt {
            events.raise(Event::PoseJump);
            if !has_faded {
                return unwell;
            }
        }
        let is_first = !std::mem::replace(&mut self.has_read, true);
        self.last = state;
        if too_fast {
            // The pose may be right although the velocity is implausible.
            return Sensed { state: RigidState::at_rest(state.position, state.orientation), is_first, ..unwell };
        }
        Sensed { state, is_well: !leapt, is_first, has_jumped: leapt }
    }
}
