//! Reads the positions of the nodes of soft bodies' tetrahedral meshes between two steps, and puts the nodes elsewhere.
//! A core is a rigid body inside a soft one, to which nodes are attached; nodes that are not attached to a core are
//! free. The skin of a body is its surface mesh.

use std::ops::Range;

use glam::DVec3;

use super::Simulation;
use crate::gpu::Buffer;
use crate::prepare::{Body, Embedding, Layer, Shape};
use crate::{Error, Result};

impl Simulation {
    /// Displacements of a soft body's nodes from where they would be at rest in the body as the scene places it (in the
    /// body's own axes, m), and the nodes' velocities (world axes, m/s). Both have the order of the nodes in the body's
    /// tetrahedral mesh. `None` for a body that is not soft.
    pub fn nodes(&self, body: usize) -> Result<Option<(Vec<DVec3>, Vec<DVec3>)>> {
        let Some(range) = self.model.soft.iter().find(|soft| soft.body == body) else { return Ok(None) };
        let Shape::Soft { layer, .. } = &self.bodies[body].shape else { return Ok(None) };
        let displacements = self.displacements(body)?;
        let mut velocities = vectors(&self.stages.elastic.velocity, range.nodes.clone())?;
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

    /// Displacements of a soft body's nodes, as [`Simulation::nodes`] gives them; empty for a body that is not soft.
    fn displacements(&self, body: usize) -> Result<Vec<DVec3>> {
        let Some(range) = self.model.soft.iter().find(|soft| soft.body == body) else { return Ok(Vec::new()) };
        let Shape::Soft { layer, .. } = &self.bodies[body].shape else { return Ok(Vec::new()) };
        let Body { position, orientation, .. } = self.bodies[body];
        let mut displacements = vectors(&self.stages.elastic.displacement, range.nodes.clone())?;
        for ((d, rest), node) in displacements.iter_mut().zip(&layer.nodes).zip(range.nodes.clone()) {
            let frame = self.model.node_info[node][2] as usize;
            let local = *rest - self.model.frames[frame].rest_centre + *d;
            *d = orientation.conjugate() * (self.frames.world(frame, local) - position) - *rest;
        }
        Ok(displacements)
    }

    /// Number of a body's nodes; 0 for a body that is not soft.
    #[doc(hidden)]
    pub fn node_count(&self, body: usize) -> usize {
        self.model.soft.iter().find(|soft| soft.body == body).map_or(0, |soft| soft.nodes.len())
    }

    /// World positions of a soft body's nodes, m, in the order of its tetrahedral mesh; empty for a body that is not
    /// soft.
    pub fn node_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        let shape = self.bodies.get(body).map(|body| &body.shape);
        let Some(Shape::Soft { layer, .. }) = shape else { return Ok(Vec::new()) };
        let moved = self.displacements(body)?;
        let Body { position, orientation, .. } = self.bodies[body];
        Ok(layer.nodes.iter().zip(&moved).map(|(rest, d)| position + orientation * (*rest + *d)).collect())
    }

    /// World positions of the vertices of a soft body's skin, m, in the skin's order; empty for a body that is not
    /// soft.
    pub fn skin_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        match self.bodies.get(body).map(|body| &body.shape) {
            Some(Shape::Soft { .. }) => self.vertex_positions(body),
            _ => Ok(Vec::new()),
        }
    }

    /// World positions of the vertices of the skin of body `body`, m; the index after that of the last body is the
    /// tool's.
    pub fn vertex_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        let skin = self.posed_skin(body)?;
        Ok((0..skin.len()).map(|vertex| skin.position(vertex)).collect())
    }

    /// The skin of a body as it is now; the index after that of the last body is the tool's.
    pub(super) fn posed_skin(&self, body: usize) -> Result<PosedSkin<'_>> {
        Ok(match self.bodies.get(body).map(|placed| (placed, &placed.shape)) {
            None => {
                let place = self.tool.as_ref().map(|tool| (tool.centre, tool.orientation));
                let skin = if place.is_some() { self.tool_skin() } else { Vec::new() };
                let (centre, turn) = place.unwrap_or_default();
                PosedSkin::Whole(skin.iter().map(|x| centre + turn * *x).collect())
            }
            Some((_, Shape::Rigid { skin, .. })) => {
                let frame = self.model.body_frames[body] as usize;
                let centre = self.model.frames[frame].rest_centre;
                PosedSkin::Whole(skin.vertices.iter().map(|x| self.frames.world(frame, *x - centre)).collect())
            }
            Some((placed, Shape::Soft { layer, skin, embedding, .. })) => {
                PosedSkin::Embedded { placed, layer, rest: &skin.vertices, embedding, moved: self.displacements(body)? }
            }
            Some((_, Shape::Plane { .. })) => PosedSkin::Whole(Vec::new()),
        })
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

/// The skin of a body as it is now, of which single vertices can be asked for.
pub(super) enum PosedSkin<'a> {
    /// World positions of the vertices of a rigid body, m.
    Whole(Vec<DVec3>),
    /// A soft body, and the displacements of its nodes in its own axes, m.
    Embedded { placed: &'a Body, layer: &'a Layer, rest: &'a [DVec3], embedding: &'a [Embedding], moved: Vec<DVec3> },
}

impl PosedSkin<'_> {
    /// Number of vertices.
    pub(super) fn len(&self) -> usize {
        match self {
            PosedSkin::Whole(positions) => positions.len(),
            PosedSkin::Embedded { rest, .. } => rest.len(),
        }
    }

    /// World position of a vertex, m.
    pub(super) fn position(&self, vertex: usize) -> DVec3 {
        match self {
            PosedSkin::Whole(positions) => positions[vertex],
            PosedSkin::Embedded { placed, layer, rest, embedding, moved } => {
                let displaced = embedding[vertex].interpolate(&layer.tetrahedra, moved);
                placed.position + placed.orientation * (rest[vertex] + displaced)
            }
        }
    }
}

/// The vectors that an array of vec4 holds in a range.
fn vectors(buffer: &Buffer, range: Range<usize>) -> Result<Vec<DVec3>> {
    let all = buffer.read::<[f32; 4]>()?;
    Ok(all[range].iter().map(|x| DVec3::new(x[0].into(), x[1].into(), x[2].into())).collect())
}
