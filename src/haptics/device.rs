//! What every haptic device does: it is read once a tick and told once a tick what to play.

use serde::{Deserialize, Serialize};

use crate::scene::Profile;
use crate::step::{RigidState, Wrench};

/// What a device says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// When it was measured: s on the clock that [`Device::read`] was given.
    pub time: f64,
    /// Where the device is; a device that does not sense rotation reports the identity.
    pub state: RigidState,
    /// A bit each, the first button in the lowest; 1: pressed.
    pub buttons: u32,
}

/// Why a device could not be read or written. None of them ends the loop: it plays nothing until the device is back.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// It is unplugged, or its service does not answer: what was found, and what to do.
    #[error("the haptic device is lost: {0}")]
    Lost(String),
    /// It answers with what cannot be: what was found.
    #[error("the haptic device says what cannot be: {0}")]
    Garbled(String),
}

/// A haptic device, or what stands in for one. The loop's thread alone uses it; no call may wait for longer than a small
/// part of a tick.
pub trait Device: Send {
    /// Makes ready to be read; the force is zero afterwards.
    fn open(&mut self) -> Result<(), Fault>;
    /// What it may be asked to play. A device that learns only in [`Device::open`] which hardware it is gives the smallest
    /// limits that may be the hardware's until then, and never smaller ones later: limits that were taken from it before
    /// stay safe.
    fn profile(&self) -> &Profile;
    /// What the user should know of the device before the loop begins, a line each; of hardware, complete once it is open.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }
    /// Where it is at `time`, s since the loop began. Simulated devices move up to that time; others report the newest that
    /// they know.
    fn read(&mut self, time: f64) -> Result<Reading, Fault>;
    /// Plays a wrench from now until the next; what the hand is pushed with. It lies within the profile's limits; the torque
    /// is zero where the profile has none.
    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault>;
    /// Plays nothing, and lets go. Called once at the end, after whatever happened.
    fn close(&mut self);
}
