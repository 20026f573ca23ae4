//! The contacts of the last step, as [`Simulation::contacts`] returns them: position, depth, pressure and friction of
//! each.

use glam::DVec3;

use super::Simulation;
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

impl Simulation {
    /// The contacts of the last step, without those that were released (left without stiffness) because they would have
    /// pulled. This costs transfers from the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed.
    pub fn contacts(&self) -> Result<Vec<ContactPoint>> {
        let (_, contacts) = self.touch()?;
        if contacts.is_empty() {
            return Ok(Vec::new());
        }
        let tractions = self.tractions(&contacts)?;
        let ranges = self.skin_ranges();
        let mut places: Vec<Vec<DVec3>> = vec![Vec::new(); ranges.len()];
        for body in contacts.iter().map(|contact| self.side_bodies(self.tested_side(contact))[0]) {
            if places[body].is_empty() {
                places[body] = self.vertex_positions(body)?;
            }
        }
        let wide = |[x, y, z]: [f32; 3]| DVec3::new(x.into(), y.into(), z.into());
        let point = |(contact, traction): (&shaders::Contact, &Traction)| {
            let side = self.tested_side(contact);
            let bodies = self.side_bodies(side);
            let index = |vertex: u32| vertex as usize - ranges[bodies[0]].start;
            let (vertex, position) = if side == contact.side {
                let vertex = index(contact.vertex);
                (vertex, places[bodies[0]][vertex])
            } else {
                let [second, third] = contact.barycentric.map(f64::from);
                let corners = self.model.triangles[contact.triangle as usize];
                let weights = [1.0 - second - third, second, third];
                let position = (0..3).map(|k| weights[k] * places[bodies[0]][index(corners[k])]).sum();
                let nearest = (0..3).max_by(|i, k| weights[*i].total_cmp(&weights[*k])).unwrap_or(0);
                (index(corners[nearest]), position)
            };
            // The GPU's normal of a contact points from body a to body b of the pair.
            let out = if side.is_multiple_of(2) { -1.0 } else { 1.0 };
            ContactPoint {
                bodies,
                vertex,
                position,
                normal: out * wide(contact.normal),
                depth: contact.depth.into(),
                area: contact.area.into(),
                pressure: traction.pressure,
                friction: out * traction.friction,
            }
        };
        Ok(contacts.iter().zip(&tractions).filter(|(contact, _)| contact.stiffness > 0.0).map(point).collect())
    }

    /// Force of the last step's contacts on each vertex of a body's skin, N, world axes, in the skin's order; the index
    /// after that of the last body is the tool's. A contact acts on the vertex that it is found at, and with the opposite
    /// force on the corners of the triangle that this vertex has met; or, where triangles are tested for contact, on the
    /// corners of the triangle and on no vertex of the rigid body that it meets. This costs transfers from the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed.
    pub fn contact_forces(&self, body: usize) -> Result<Vec<DVec3>> {
        let range = self.skin_ranges().get(body).cloned().unwrap_or_default();
        let mut forces = vec![DVec3::ZERO; range.len()];
        let (_, contacts) = self.touch()?;
        for (contact, traction) in contacts.iter().zip(&self.tractions(&contacts)?) {
            let (side, normal) = (self.tested_side(contact), DVec3::from(contact.normal.map(f64::from)));
            let [tested, other] = self.side_bodies(side);
            if contact.stiffness <= 0.0 || ![tested, other].contains(&body) {
                continue;
            }
            let out = if side.is_multiple_of(2) { -1.0 } else { 1.0 };
            let force = f64::from(contact.area) * out * (traction.pressure * normal + traction.friction);
            let is_by_vertex = side == contact.side;
            if is_by_vertex && tested == body {
                forces[contact.vertex as usize - range.start] += force;
            } else if is_by_vertex != (tested == body) && contact.triangle != shaders::NONE {
                let [second, third] = contact.barycentric.map(f64::from);
                let sign = if is_by_vertex { -1.0 } else { 1.0 };
                let corners = self.model.triangles[contact.triangle as usize];
                for (corner, weight) in corners.into_iter().zip([1.0 - second - third, second, third]) {
                    forces[corner as usize - range.start] += sign * weight * force;
                }
            }
        }
        Ok(forces)
    }

    /// The tractions (pressure and friction) at the last step's contacts; at the start of the step where those at its
    /// end are not known.
    fn tractions(&self, contacts: &[shaders::Contact]) -> Result<Vec<Traction>> {
        let Some(touch) = self.stages.touch.as_ref().filter(|_| self.is_solved) else {
            return Ok(contacts.iter().map(start_traction).collect());
        };
        let forces = touch.contact.touch.contact_forces.read::<[f32; 4]>()?;
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
