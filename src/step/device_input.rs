//! Input of a step from the haptic loop, which runs faster than the steps and moves the tool between two of them.

use serde::{Deserialize, Serialize};

use super::rigid::RigidState;
use crate::scene::Coupling;

/// The haptic loop's input to a step: haptic device, tool, and the virtual coupling between them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeviceInput {
    /// Number of ticks (runs of the loop's body) done.
    pub ticks: u64,
    /// When the last tick began, s on the loop's clock.
    pub time: f64,
    /// Pose and twist of the haptic device.
    pub device: RigidState,
    /// Pose and twist of the tool.
    pub tool: RigidState,
    /// Virtual coupling between device and tool; `None` before the first tick.
    pub coupling: Option<Coupling>,
    /// Greatest force of the coupling's spring, N: the greatest force that the device may play, so that the tool
    /// presses no harder than the hand feels.
    pub max_force: f64,
}
