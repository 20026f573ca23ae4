//! Reads the positions of the nodes of soft bodies' tetrahedral meshes between two steps, and puts the nodes elsewhere.
//! A core is a rigid body inside a soft one, to which nodes are attached; nodes that are not attached to a core are
//! free. The skin of a body is its surface mesh.

use glam::DVec3;

use super::Simulation;
use crate::gpu::Buffer;
use crate::prepare::{Body, Embedding, Shape};
use crate::{Error, Result};

impl Simulation {
    /// Displacements of a soft body's nodes from where they would be at rest in the body as the scene places it (in the
    /// body's own axes, m), and the nodes' velocities (world axes, m/s). Both have the order of the nodes in the body's
    /// tetrahedral mesh. `None` for a body that is not soft.
    pub fn nodes(&self, body: usize) -> Result<Option<(Vec<DVec3>, Vec<DVec3>)>> {
        let Some(range) = self.model.soft.iter().find(|soft| soft.body == body) else { return Ok(None) };
        let Shape::Soft { layer, .. } = &self.bodies[body].shape else { return Ok(None) };
        let read = |buffer: &Buffer| -> Result<Vec<DVec3>> {
            let all = buffer.read::<[f32; 4]>()?;
            let own = &all[range.nodes.clone()];
            Ok(own.iter().map(|x| DVec3::new(x[0].into(), x[1].into(), x[2].into())).collect())
        };
        let Body { position, orientation, .. } = self.bodies[body];
        let mut displacements = read(&self.stages.elastic.displacement)?;
        for ((d, rest), node) in displacements.iter_mut().zip(&layer.nodes).zip(range.nodes.clone()) {
            let frame = self.model.node_info[node][2] as usize;
            let local = *rest - self.model.frames[frame].rest_centre + *d;
            *d = orientation.conjugate() * (self.frames.world(frame, local) - position) - *rest;
        }
        let mut velocities = read(&self.stages.elastic.velocity)?;
        for ((v, rest), node) in velocities.iter_mut().zip(&layer.nodes).zip(range.nodes.clone()) {
            let frame = self.model.node_info[node][2] as usize;
            // The GPU updates the velocities of nodes attached to a dynamic core only at the start of the next step.
            if let Some((linear, angular)) = self.frames.twist(frame).filter(|_| self.model.is_attached(node)) {
                let arm = *rest - self.model.frames[frame].rest_centre;
                *v = linear + angular.cross(self.frames.place(frame).rotation * arm);
            }
        }
        Ok(Some((displacements, velocities)))
    }

    /// World positions of a soft body's nodes, m, in the order of its tetrahedral mesh; empty for a body that is not
    /// soft.
    pub fn node_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        let shape = self.bodies.get(body).map(|body| &body.shape);
        let Some(Shape::Soft { layer, .. }) = shape else { return Ok(Vec::new()) };
        let Some((moved, _)) = self.nodes(body)? else { return Ok(Vec::new()) };
        let Body { position, orientation, .. } = self.bodies[body];
        Ok(layer.nodes.iter().zip(&moved).map(|(rest, d)| position + orientation * (*rest + *d)).collect())
    }

    /// World positions of the vertices of a soft body's skin, m, in the skin's order; empty for a body that is not
    /// soft.
    pub fn skin_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        let shape = self.bodies.get(body).map(|body| &body.shape);
        let Some(Shape::Soft { layer, skin, embedding, .. }) = shape else { return Ok(Vec::new()) };
        let Some((moved, _)) = self.nodes(body)? else { return Ok(Vec::new()) };
        let Body { position, orientation, .. } = self.bodies[body];
        let displaced = |e: &Embedding| -> DVec3 {
            let nodes = layer.tetrahedra[e.tetrahedron as usize];
            nodes.iter().zip(e.weights).map(|(n, w)| w * moved[*n as usize]).sum()
        };
        let all = skin.vertices.iter().zip(embedding);
        Ok(all.map(|(rest, e)| position + orientation * (*rest + displaced(e))).collect())
    }
    /// Gives the free nodes of a soft body new displacements and velocities, both in the axes and the order of
    /// [`Simulation::nodes`]; nodes attached to cores stay where they are. For tests and experiments only: what the
    /// solver keeps of the last step (its solution and its residual, with which it starts the next step) is not adapted
    /// to the new positions.
    #[doc(hidden)]
    pub fn place_nodes(&mut self, body: usize, displacements: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let soft = self.model.soft.iter().find(|soft| soft.body == body);
        let range = soft.map(|soft| soft.nodes.clone()).unwrap_or_default();
        if range.len() != displacements.len() || range.len() != velocities.len() {
            let given = displacements.len().min(velocities.len());
            let problem =
                format!("{given} node displacements or velocities were given for a body with {} nodes", range.len());
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
