//! Nodes of a soft body put elsewhere between two steps: starts that no scene file can ask for.

use glam::DVec3;

use super::Simulation;
use crate::prepare::Shape;
use crate::{Error, Result};

impl Simulation {
    /// Puts the free nodes of a soft body elsewhere and gives them velocities, both as [`Simulation::nodes`] tells them; what
    /// cores carry stays. For tests and experiments: what the solver remembers of the last step is not asked to fit.
    pub fn place_nodes(&mut self, body: usize, displacements: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let soft = self.model.soft.iter().find(|soft| soft.body == body);
        let range = soft.map(|soft| soft.nodes.clone()).unwrap_or_default();
        if range.len() != displacements.len() || range.len() != velocities.len() {
            let given = displacements.len().min(velocities.len());
            let problem = format!("{given} nodes are placed of a body that has {}", range.len());
            return Err(Error::Simulation(problem));
        }
        let Shape::Soft { layer, .. } = &self.bodies[body].shape else { return Ok(()) };
        let placed = &self.bodies[body];
        let (moved, speed) = (&self.stages.elastic.displacement, &self.stages.elastic.velocity);
        let (mut all, mut all_speeds) = (moved.read::<[f32; 4]>()?, speed.read::<[f32; 4]>()?);
        for (k, node) in range.enumerate() {
            if !self.model.is_free(node) {
                continue;
            }
            let place = self.frames.place(self.model.node_info[node][2] as usize);
            let world = placed.position + placed.orientation * (layer.nodes[k] + displacements[k]);
            let rest = layer.nodes[k] - self.model.frames[self.model.node_info[node][2] as usize].rest_centre;
            let local = place.rotation.conjugate() * (world - place.centre) - rest;
            all[node] = local.as_vec3().extend(0.0).to_array();
            all_speeds[node] = velocities[k].as_vec3().extend(0.0).to_array();
        }
        moved.write(&all)?;
        speed.write(&all_speeds)
    }
}
