//! What of a device's readings can be believed.

use super::device::{Fault, Reading};
use super::event::{Event, Events};
use crate::step::RigidState;
use crate::step::drive::rotation_vector;

/// No hand moves a device faster, m/s.
const FASTEST: f64 = 5.0;
/// Nor turns it faster, rad/s.
const FASTEST_TURN: f64 = 60.0;

/// Remembers the last reading that was right.
#[derive(Debug, Clone)]
pub struct Sense {
    last: RigidState,
    has_read: bool,
}

/// A reading as it can be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// Where the device is; where it was, at rest, if nobody knows.
    pub state: RigidState,
    /// Whether it was read and believed in this tick.
    pub is_well: bool,
    /// Whether this is the first that was.
    pub is_first: bool,
    /// Whether it is believed though it is far from the last one.
    pub has_jumped: bool,
}

impl Sense {
    /// `start` is taken for the device's state until it is read.
    pub fn new(start: RigidState) -> Sense {
        Sense { last: start, has_read: false }
    }

    /// Takes a reading. One that leapt is believed once the force `has_faded`; until then the device is where it was.
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
            // Its pose may be right where its velocity cannot be.
            return Sensed { state: RigidState::at_rest(state.position, state.orientation), is_first, ..unwell };
        }
        Sensed { state, is_well: !leapt, is_first, has_jumped: leapt }
    }
}
