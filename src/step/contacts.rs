//! The contacts of the last step, as [`Simulation::contacts`] returns them: position, depth, pressure and friction of
//! each.

use glam::DVec3;

use super::Simulation;
use super::nodes::PosedSkin;
use crate::Result;
use crate::shaders::{self, StepParams};
use crate::stages::contact_law::{Traction, end_traction, start_traction};

/// A contact: a vertex of a skin (surface mesh) that lies inside another body or, where triangles are tested for contact
/// (scene key `contact.samples`), the part of a triangle that does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The body that the vertex or triangle belongs to, and the body that it touches, as indices; the tool comes after the
    /// bodies.
    pub bodies: [usize; 2],
    /// Index of the vertex in the skin of the body that it belongs to; of a triangle, the corner nearest to its centre of
    /// pressure.
    pub vertex: usize,
    /// World position of the vertex, or of the triangle's centre of pressure, now, m.
    pub position: DVec3,
    /// Unit normal, world axes, pointing out of the touched body.
    pub normal: DVec3,
    /// How deep the vertex lies in the touched body, along the normal, m; of a triangle, the mean over its part.
    pub depth: f64,
    /// Area of skin that the vertex stands for, or of the triangle's part, projected along the normal, m^2.
    pub area: f64,
    /// Pressure along the normal at the end of the step, Pa; pressure times area is the contact's part of the net
    /// force. Where the pressure at the end is not known, this is the pressure at the start of the step. The pressure
    /// at the end is not known after a saved state was restored, after a frozen step (one in which no attempt
    /// succeeded), and after [`Simulation::set_contact`] brought friction into a scene that had none, each time until
    /// the next step.
    pub pressure: f64,
    /// Friction force per area, at the end of the step, on the body that the vertex or triangle belongs to, world axes, Pa; zero
    /// where it is not known, in the same cases as for the pressure.
    pub friction: DVec3,
}

impl ContactPoint {
    /// Force on the body that the vertex or triangle belongs to, world axes, N.
    pub fn force(&self) -> DVec3 {
        self.area * (self.pressure * self.normal + self.friction)
    }
}

/// The force of a contact on a vertex of a skin.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VertexForce {
    /// Index of the body; the tool comes after the bodies.
    pub body: usize,
    /// Index of the vertex in the body's skin.
    pub vertex: usize,
    /// Force, world axes, N.
    pub force: DVec3,
}

impl Simulation {
    /// The contacts of the last step, without those that were released (left without stiffness) because they would have
    /// pulled. This costs transfers from the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed.
    pub fn contacts(&self) -> Result<Vec<ContactPoint>> {
        Ok(self.contacts_and_forces()?.0)
    }

    /// Force of the last step's contacts on each vertex of a body's skin, N, world axes, in the skin's order; the index
    /// after that of the last body is the tool's. A contact acts on the vertex that it is found at, and with the opposite
    /// force on the corners of the triangle that this vertex has met; or, where triangles are tested for contact, on the
    /// corners of the triangle and on no vertex of the rigid body that it meets. This costs transfers from the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed.
    pub fn contact_forces(&self, body: usize) -> Result<Vec<DVec3>> {
        let size = self.skin_ranges().get(body).map_or(0, |range| range.len());
        let mut forces = vec![DVec3::ZERO; size];
        for own in self.contacts_and_forces()?.1.iter().filter(|force| force.body == body) {
            forces[own.vertex] += own.force;
        }
        Ok(forces)
    }

    /// What [`Simulation::contacts`] returns, and the forces that [`Simulation::contact_forces`] sums.
    #[doc(hidden)]
    pub fn contacts_and_forces(&self) -> Result<(Vec<ContactPoint>, Vec<VertexForce>)> {
        let ranges = self.skin_ranges();
        let mut forces = Vec::new();
        let mut push = |body: usize, vertex: u32, force: DVec3| {
            forces.push(VertexForce { body, vertex: vertex as usize - ranges[body].start, force });
        };
        let contacts = self.gpu_contacts()?;
        let tractions = self.tractions(&contacts)?;
        let mut skins: Vec<Option<PosedSkin>> = ranges.iter().map(|_| None).collect();
        let mut points = Vec::new();
        for (contact, traction) in contacts.iter().zip(&tractions).filter(|(contact, _)| contact.stiffness > 0.0) {
            let side = self.tested_side(contact);
            let [tested, other] = self.side_bodies(side);
            let skin = match &mut skins[tested] {
                Some(skin) => skin,
                none => none.insert(self.posed_skin(tested)?),
            };
            let at = |vertex: u32| skin.position(vertex as usize - ranges[tested].start);
            // The GPU's normal of a contact points from body a to body b of the pair.
            let out = if side.is_multiple_of(2) { -1.0 } else { 1.0 };
            let normal = out * DVec3::from(contact.normal.map(f64::from));
            let friction = out * traction.friction;
            let force = f64::from(contact.area) * (traction.pressure * normal + friction);
            let [second, third] = contact.barycentric.map(f64::from);
            let weights = [1.0 - second - third, second, third];
            // A half-space has no triangles.
            let triangle = self.model.triangles.get(contact.triangle as usize);
            let corners = triangle.into_iter().flat_map(|&[a, b, c, _]| [a, b, c].into_iter().zip(weights));
            let (vertex, position) = if side == contact.side {
                push(tested, contact.vertex, force);
                corners.for_each(|(corner, weight)| push(other, corner, -weight * force));
                (contact.vertex, at(contact.vertex))
            } else {
                corners.clone().for_each(|(corner, weight)| push(tested, corner, weight * force));
                let position = corners.clone().map(|(corner, weight)| weight * at(corner)).sum();
                let nearest = corners.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(contact.vertex, |(corner, _)| corner);
                (nearest, position)
            };
            points.push(ContactPoint {
                bodies: [tested, other],
                vertex: vertex as usize - ranges[tested].start,
                position,
                normal,
                depth: contact.depth.into(),
                area: contact.area.into(),
                pressure: traction.pressure,
                friction,
            });
        }
        Ok((points, forces))
    }

    /// The tractions (pressure and friction) at the last step's contacts; at the start of the step where those at its
    /// end are not known.
    fn tractions(&self, contacts: &[shaders::Contact]) -> Result<Vec<Traction>> {
        let Some(touch) = self.stages.touch.as_ref().filter(|_| self.is_solved) else {
            return Ok(contacts.iter().map(start_traction).collect());
        };
        let forces = touch.contact.touch.contact_forces.read_first::<[f32; 4]>(contacts.len())?;
        let h = self.stages.common.params.mapped::<StepParams>()?[0].dt;
        Ok(contacts.iter().zip(forces).map(|(contact, force)| end_traction(contact, force, h)).collect())
    }

    /// The side whose skin was tested for this contact. Where triangles are tested, the GPU keeps a contact as one of the
    /// other body's vertex.
    fn tested_side(&self, contact: &shaders::Contact) -> u32 {
        contact.side ^ self.model.pairs[contact.side as usize / 2].by_triangles
    }

    /// For a side of a pair of bodies a and b (2 times the pair's index, plus 1 for side b): the body whose skin
    /// vertices are tested for contact on that side, and the other body.
    fn side_bodies(&self, side: u32) -> [usize; 2] {
        let [a, b] = self.model.pair_bodies[side as usize / 2];
        if side.is_multiple_of(2) { [a, b] } else { [b, a] }
    }
}
