//! The contacts of the last step, as a user may look at them.

use glam::DVec3;

use super::Simulation;
use crate::Result;

/// A colliding skin vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// Whose vertex it is, and what it touches; the tool comes after the bodies.
    pub bodies: [usize; 2],
    /// Of the body's skin.
    pub vertex: usize,
    /// Where the vertex is now, world, m.
    pub position: DVec3,
    /// Unit, world, out of what is touched.
    pub normal: DVec3,
    /// m.
    pub depth: f64,
    /// Skin that it stands for, as seen along the normal, m^2.
    pub area: f64,
    /// With which the step began to push, Pa.
    pub pressure: f64,
}

impl Simulation {
    /// The contacts of the last step, but for those that were dropped because they would have pulled. Costs transfers of
    /// its own.
    pub fn contacts(&self) -> Result<Vec<ContactPoint>> {
        let (_, contacts) = self.touch()?;
        if contacts.is_empty() {
            return Ok(Vec::new());
        }
        let ranges = self.skin_ranges();
        let mut places: Vec<Vec<DVec3>> = vec![Vec::new(); ranges.len()];
        for body in contacts.iter().map(|contact| self.side_bodies(contact.side)[0]) {
            if places[body].is_empty() {
                places[body] = self.vertex_positions(body)?;
            }
        }
        let wide = |[x, y, z]: [f32; 3]| DVec3::new(x.into(), y.into(), z.into());
        let point = |contact: &crate::shaders::Contact| {
            let bodies = self.side_bodies(contact.side);
            let vertex = contact.vertex as usize - ranges[bodies[0]].start;
            // The contact's normal points from a to b.
            let out = if contact.side.is_multiple_of(2) { -1.0 } else { 1.0 };
            let push = contact.stiffness * contact.depth + contact.damping * contact.rate;
            ContactPoint {
                bodies,
                vertex,
                position: places[bodies[0]][vertex],
                normal: out * wide(contact.normal),
                depth: contact.depth.into(),
                area: contact.area.into(),
                pressure: f64::from(push).max(0.0),
            }
        };
        Ok(contacts.iter().filter(|contact| contact.stiffness > 0.0).map(point).collect())
    }

    /// Whose vertices a side of a pair gathers, and the other body of it.
    fn side_bodies(&self, side: u32) -> [usize; 2] {
        let [a, b] = self.model.pair_bodies[side as usize / 2];
        if side.is_multiple_of(2) { [a, b] } else { [b, a] }
    }
}
