//! The report of a step: what the step did, and the state at its end. The tool is the rigid body that the haptic device
//! leads. A contact patch is a place with one normal where two bodies may touch. A probe is a skin vertex whose
//! position the scene records.

use glam::{DQuat, DVec3};

use crate::stages::Flags;

/// Results of one step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// Number of steps done, this one included.
    pub step: u64,
    /// Time at the end of the step, s.
    pub time: f64,
    /// State of the tool, and the wrench on it, if the scene has a tool.
    pub tool: Option<ToolReport>,
    /// Number of contacts, which are vertices of a skin (surface mesh) inside another body; `None` where nothing can
    /// collide.
    pub contacts: Option<u32>,
    /// Greatest depth of a contact, m; `None` where nothing can collide.
    pub max_depth: Option<f64>,
    /// Greatest angle by which the normal of a contact patch turned in the step, rad; `None` where nothing can collide.
    pub normal_turn: Option<f64>,
    /// Number of conjugate gradient iterations, summed over all linear solves of the step.
    pub iterations: u32,
    /// Relative residual of the linear system at the end of the last solve.
    pub residual: f64,
    /// Residual of the step's nonlinear equations at its end, in the norm of the preconditioner and relative to the
    /// right-hand side of the first Newton iteration (a number without a unit); the greatest of a step that was repeated
    /// in parts. `None` where steps have a single Newton iteration, or everything stopped.
    pub nonlinear_residual: Option<f64>,
    /// Flags that tell what went wrong in the step; none is set if nothing did.
    pub flags: Flags,
    /// Wall time of the step, from when the haptic device's pose is known until the contact wrench on the tool is
    /// known, microseconds.
    pub step_us: f64,
    /// World positions of the probes, m, in the order in which the scene lists them.
    pub probes: Vec<DVec3>,
}

/// The tool at the end of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ToolReport {
    /// Pose of the tool.
    pub tool: Pose,
    /// Pose of the haptic device.
    pub device: Pose,
    /// Contact force on the tool, world axes, N.
    pub force: DVec3,
    /// Contact torque on the tool about its centre, world axes, N m.
    pub torque: DVec3,
}

/// A position (m) and an orientation in the world.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pose {
    /// Position, m.
    pub position: DVec3,
    /// Orientation, as the rotation from the object's axes to the world's.
    pub orientation: DQuat,
}
