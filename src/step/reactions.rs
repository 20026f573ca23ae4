//! Reactions: the forces and torques by which supports, and cores of prescribed motion (rigid parts that the solver does
//! not move), hold the soft bodies.

use glam::DVec3;

use super::{Flags, Simulation, Wrench};
use crate::Result;
use crate::shaders::Report;

impl Simulation {
    /// Names of what the reactions of a step report are of, in their order: `BODY.NAME` for each fixed or driven core,
    /// and then each support, of each body whose scene asks for reactions. A core to which joints are attached has
    /// none.
    pub fn reaction_names(&self) -> impl Iterator<Item = &str> {
        self.model.held.holders.iter().map(|holder| holder.name.as_str())
    }

    /// The reactions of the last step, see [`crate::StepReport::reactions`]; empty before the first step, and after a
    /// state was restored.
    pub fn reactions(&self) -> &[Wrench] {
        &self.last_reactions
    }

    /// The reactions of the last attempt at the step that `report` is of. They are zero where the step failed.
    pub(super) fn read_reactions(&self, report: &Report) -> Result<Vec<Wrench>> {
        let Some(supports) = &self.stages.solve.supports else { return Ok(Vec::new()) };
        let count = self.model.held.holders.len();
        if Flags(report.flags).contains(Flags::FROZEN) {
            return Ok(vec![Wrench::ZERO; count]);
        }
        let all = supports.reactions.mapped::<[[f32; 3]; 2]>()?;
        let wide = |x: [f32; 3]| DVec3::from(x.map(f64::from));
        // The GPU's positions are relative to an origin near the tool.
        let wrench = |[force, torque]: &[[f32; 3]; 2]| {
            let force = wide(*force);
            Wrench { force, torque: wide(*torque) + self.step_origin.cross(force) }
        };
        Ok(all[..count].iter().map(wrench).collect())
    }
}
