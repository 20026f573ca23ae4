//! The interface of a haptic device. The haptic loop reads the device once a tick (one iteration of the loop, 1 ms
//! unless a scene sets another rate) and commands a wrench (force and torque) to it once a tick.

use serde::{Deserialize, Serialize};

use crate::scene::Profile;
use crate::step::{RigidState, Wrench};

/// One measurement of a haptic device.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Time of the measurement, s since the haptic loop began.
    pub time: f64,
    /// Pose and twist of the device's handle; a device that does not sense rotation reports the identity orientation.
    pub state: RigidState,
    /// Pressed buttons, one bit each: the first button is the lowest bit, and a set bit means pressed.
    pub buttons: u32,
}

/// Why a device could not be opened, read or written. Where it cannot be opened, the loop does not begin. A later fault
/// does not end the loop, which commands no force until the device is back.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The device is unplugged, or its service does not answer. The text describes the finding and a remedy.
    #[error("the haptic device is lost: {0}")]
    Lost(String),
    /// The device answers with impossible values. The text describes the finding.
    #[error("the haptic device returned invalid data: {0}")]
    Garbled(String),
}

/// A haptic device, or a simulation of one. Only the loop's thread uses it; no call may block for longer than a small
/// part of a tick.
pub trait Device: Send {
    /// Opens the device, so that it can be read. It exerts no force until [`Device::write`] commands one.
    fn open(&mut self) -> Result<(), Fault>;
    /// Limits of the wrench that the device may be commanded to exert, and of its workspace. Some drivers learn only in
    /// [`Device::open`] which hardware they have. Until then they return the smallest limits of all hardware that may
    /// be found; after that they return limits that are no smaller, so that limits read before opening stay safe.
    fn profile(&self) -> &Profile;
    /// Notes about this device that the user should read before the loop begins, one line each. For hardware, the
    /// notes are complete only after [`Device::open`].
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }
    /// Measures the device at `time`, s since the loop began. A simulated device advances its motion to that time;
    /// hardware reports its newest measurement.
    fn read(&mut self, time: f64) -> Result<Reading, Fault>;
    /// Commands the wrench that the device exerts on the hand from now until the next call. The wrench lies within the
    /// profile's limits; its torque is zero if the profile allows no torque.
    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault>;
    /// Stops all force and releases the device. The loop calls this function once when the loop ends, for
    /// whatever reason.
    fn close(&mut self);
}
