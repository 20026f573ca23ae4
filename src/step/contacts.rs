//! The contacts of the last step, as [`Simulation::contacts`] returns them: position, depth, pressure and friction of
//! each.

use glam::DVec3;

use super::Simulation;
use crate::Result;
use crate::shaders::{self, StepParams};
use crate::stages::contact_law::{Traction, end_traction, start_traction};

/// A contact: a vertex of a skin (surface mesh) that lies inside another body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The body that the vertex belongs to, and the body that it touches, as indices; the tool comes after the bodies.
    pub bodies: [usize; 2],
    /// Index of the vertex in the skin of the body that it belongs to.
    pub vertex: usize,
    /// World position of the vertex now, m.
    pub position: DVec3,
    /// Unit normal, world axes, pointing out of the touched body.
    pub normal: DVec3,
    /// How deep the vertex lies in the touched body, along the normal, m.
    pub depth: f64,
    /// Area of skin that the vertex stands for, projected along the normal, m^2.
    pub area: f64,
    /// Pressure along the normal at the end of the step, Pa; pressure times area is the contact's part of the net
    /// force. Where the pressure at the end is not known, this is the pressure at the start of the step. The pressure
    /// at the end is not known after a saved state was restored, after a frozen step (one in which no attempt
    /// succeeded), and after [`Simulation::set_contact`] brought friction into a scene that had none, each time until
    /// the next step.
    pub pressure: f64,
    /// Friction force per area, at the end of the step, on the body that the vertex belongs to, world axes, Pa; zero
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
        for body in contacts.iter().map(|contact| self.side_bodies(contact.side)[0]) {
            if places[body].is_empty() {
                places[body] = self.vertex_positions(body)?;
            }
        }
        let wide = |[x, y, z]: [f32; 3]| DVec3::new(x.into(), y.into(), z.into());
        let point = |(contact, traction): (&shaders::Contact, &Traction)| {
            let bodies = self.side_bodies(contact.side);
            let vertex = contact.vertex as usize - ranges[bodies[0]].start;
            // The GPU's normal of a contact points from body a to body b of the pair.
            let out = if contact.side.is_multiple_of(2) { -1.0 } else { 1.0 };
            ContactPoint {
                bodies,
                vertex,
                position: places[bodies[0]][vertex],
                normal: out * wide(contact.normal),
                depth: contact.depth.into(),
                area: contact.area.into(),
                pressure: traction.pressure,
                friction: out * traction.friction,
            }
        };
        Ok(contacts.iter().zip(&tractions).filter(|(contact, _)| contact.stiffness > 0.0).map(point).collect())
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

    /// For a side of a pair of bodies a and b (2 times the pair's index, plus 1 for side b): the body whose skin
    /// vertices are tested for contact on that side, and the other body.
    fn side_bodies(&self, side: u32) -> [usize; 2] {
        let [a, b] = self.model.pair_bodies[side as usize / 2];
        if side.is_multiple_of(2) { [a, b] } else { [b, a] }
    }
}
