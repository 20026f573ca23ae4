//! The report of a step: what the step did, and the state at its end. The tool is the rigid body that the haptic device
//! leads. A contact patch is a place with one normal where two bodies may touch. A probe is a skin vertex whose
//! position the scene records.

use glam::{DQuat, DVec3};

use super::Wrench;
use crate::stages::Flags;

/// Results of one step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// Number of steps done, this one included.
    pub step: u64,
    /// Time at the end of the step, s.
    pub time: f64,
    /// State of the tool, and the wrench on it, if the scene has a tool; of several tools the first.
    pub tool: Option<ToolReport>,
    /// The tools after the first, in the scene's order.
    pub further_tools: Vec<ToolReport>,
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
    /// Number of parts in which the step was done: 1, or more where the tool could have passed through a body unseen. The
    /// wrench on the tool is that at the end of the last part.
    pub parts: u32,
    /// Wall time of the step, from when the haptic device's pose is known until the contact wrench on the tool is
    /// known, microseconds.
    pub step_us: f64,
    /// What the step asked of the GPU.
    pub work: StepWork,
    /// World positions of the probes, m, in the order in which the scene lists them.
    pub probes: Vec<DVec3>,
    /// Reactions: the force (N) and the torque about the world's origin (N m) by which each support, and each fixed or
    /// driven core, acts on its soft body; world axes, in the order of [`crate::Simulation::reaction_names`]. Torques are
    /// those of forces at the places of the nodes at the start of the step. The inertia of nodes attached to a driven
    /// core is not part of it; their weight and their mass-proportional damping are. Of a step in parts, the reactions in the last part.
    pub reactions: Vec<Wrench>,
}

impl StepReport {
    /// All tools, in the scene's order.
    pub fn tools(&self) -> impl Iterator<Item = &ToolReport> {
        self.tool.iter().chain(&self.further_tools)
    }
}

/// What a step asked of the GPU, in all attempts at it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepWork {
    /// Number of linear solves; one more for each time that contacts were released, and one for the check after the last
    /// of several Newton iterations.
    pub solves: u32,
    /// Number of submits to the GPU; the host waits for the end of each.
    pub submits: u32,
    /// Number of iterations that were submitted. Those after a solve has ended find nothing to do, so that this number
    /// is at least the number of iterations done.
    pub planned_iterations: u32,
    /// Number of passes (dispatches, draws, fills and copies) that had to wait for an earlier pass, those of planned
    /// iterations that found nothing to do included.
    pub dependent_passes: u32,
    /// Time from the first to the last pass of each submit, all submits together, microseconds; `None` where the step
    /// was not timed.
    pub gpu_us: Option<f64>,
}

impl std::ops::AddAssign for StepWork {
    fn add_assign(&mut self, other: StepWork) {
        self.solves += other.solves;
        self.submits += other.submits;
        self.planned_iterations += other.planned_iterations;
        self.dependent_passes += other.dependent_passes;
        self.gpu_us = self.gpu_us.zip(other.gpu_us).map(|(a, b)| a + b);
    }
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
