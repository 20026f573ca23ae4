//! The result of a step.

use glam::{DQuat, DVec3};

use crate::stages::Flags;

/// What one step did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// Steps done, this one included.
    pub step: u64,
    /// Time at the end of the step, s.
    pub time: f64,
    /// The tool, if the scene has one.
    pub tool: Option<ToolReport>,
    /// Colliding vertices of both sides; `None` where nothing can collide.
    pub contacts: Option<u32>,
    /// Greatest depth, m; `None` where nothing can collide.
    pub max_depth: Option<f64>,
    /// How far the normal of a region turned in the step at most, rad; `None` where nothing can collide.
    pub normal_turn: Option<f64>,
    /// Conjugate gradient iterations of all solves of the step.
    pub iterations: u32,
    /// Relative residual at the end of the solve.
    pub residual: f64,
    /// What went wrong.
    pub flags: Flags,
    /// Wall time of the step, pose in to wrench out, microseconds.
    pub step_us: f64,
    /// World positions of the scene's probes, m, in the scene's order.
    pub probes: Vec<DVec3>,
}

/// The tool at the end of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ToolReport {
    /// Where the tool is.
    pub tool: Pose,
    /// Where the device is.
    pub device: Pose,
    /// Contact force on the tool, world axes, N.
    pub force: DVec3,
    /// Contact torque on the tool about its centre, world axes, N m.
    pub torque: DVec3,
}

/// A position (m) and orientation, world.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pose {
    /// Position, m.
    pub position: DVec3,
    /// Orientation.
    pub orientation: DQuat,
}
