//! What a step starts from in which the haptic loop holds the tool.

use serde::{Deserialize, Serialize};

use super::rigid::RigidState;
use crate::scene::Coupling;

/// What a step of the simulation starts from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Ticks done.
    pub ticks: u64,
    /// When the last of them began, s on the loop's clock.
    pub time: f64,
    /// The device.
    pub device: RigidState,
    /// The tool.
    pub tool: RigidState,
    /// What joins them; `None` before the first tick.
    pub coupling: Option<Coupling>,
    /// Greatest force of the coupling's stiffness, N: what may be played, so that nothing presses harder than the hand feels.
    pub max_force: f64,
}
