//! The step plan: which stages of a simulation step a scene needs, and why the other stages are left out. A stage that
//! is needed is *recorded*: its GPU commands are written once into command buffers, which every step submits. A run
//! writes the plan to `summary.json`; `palpate run --explain` prints it with every pass (dispatch, draw, fill or copy).
//! The depth stage, which finds where rays from vertices of one body's skin (surface mesh) hit the other body of a
//! pair, has two implementations (paths): graphics and compute.

mod explanation;
mod features;
mod kernels;

use crate::prepare::Body;
use crate::scene::Scene;
use crate::stages::model::Model;
use crate::stages::{self, StageNeed};

pub use explanation::{Array, Explanation, KernelUse, StageUse};
pub use features::Feature;
pub(crate) use kernels::{stage_of, why_not};

/// All stages of the step, each with the answer whether the scene needs it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// One entry per stage: whether the stage is recorded, and why or why not.
    pub entries: Vec<StageNeed>,
    /// Which path the depth stage takes (graphics or compute) and why; `None` where the stage is left out.
    pub depth: Option<String>,
}

impl Plan {
    /// The plan of a scene. `depth`: which path the depth stage takes and why; `None` where that stage is left out.
    pub fn new(scene: &Scene, model: &Model, depth: Option<String>) -> Plan {
        Plan { entries: stages::needs(scene, model, depth.clone()), depth }
    }

    /// Every feature that a scene can have, and whether this scene uses it. `bodies`: the prepared bodies without the
    /// tool; `timed_every`: every how many steps a step is timed by timestamps; 0: no step is timed.
    pub fn features(&self, scene: &Scene, model: &Model, bodies: &[Body], timed_every: u64) -> Vec<Feature> {
        features::features(&features::Known { scene, model, bodies, depth: self.depth.as_deref(), timed_every })
    }
}
