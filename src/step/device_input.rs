//! Input of a step from the haptic loop. The loop runs faster than the steps, and between two steps it moves the tool,
//! the rigid body that the haptic device leads.

use serde::{Deserialize, Serialize};

use super::rigid::RigidState;
use crate::scene::Coupling;

/// The haptic loop's input to a step: the states of haptic device and tool, and the virtual coupling (spring and
/// damper) between them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeviceInput {
    /// Number of ticks (runs of the loop's body) done.
    pub ticks: u64,
    /// Time at which the last tick began, s on the loop's clock.
    pub time: f64,
    /// Pose and twist (linear and angular velocity) of the haptic device.
    pub device: RigidState,
    /// Pose and twist of the tool.
    pub tool: RigidState,
    /// Virtual coupling between device and tool; `None` before the first tick.
    pub coupling: Option<Coupling>,
    /// Greatest force of the coupling's spring, N. It is the greatest force that the device may exert on the hand, so
    /// that the tool presses no harder than the hand feels.
    pub max_force: f64,
}
