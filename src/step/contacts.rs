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
    /// The contacts of the last step, but for those that were dropped because they would have pulled. Costs transfers of its own, and makes the arrays of [`Simulation::skins`].
    pub fn contacts(&mut self) -> Result<Vec<ContactPoint>> {
        let (_, contacts) = self.touch()?;
        if contacts.is_empty() {
            return Ok(Vec::new());
        }
        let origin = self.origin();
        let places = self.skins(origin)?.positions.read::<[f32; 4]>()?;
        let ranges = self.skin_ranges();
        let wide = |[x, y, z]: [f32; 3]| DVec3::new(x.into(), y.into(), z.into());
        let point = |contact: &crate::stages::types::Contact| {
            let side = contact.side as usize % 2;
            let [a, b] = self.model.pair_bodies[contact.side as usize / 2];
            let bodies = if side == 0 { [a, b] } else { [b, a] };
            let vertex = contact.vertex as usize;
            let [x, y, z, _] = places[vertex];
            // The contact's normal points from a to b.
            let out = if side == 0 { -1.0 } else { 1.0 };
            let push = contact.stiffness * contact.depth + contact.damping * contact.rate;
            ContactPoint {
                bodies,
                vertex: vertex - ranges[bodies[0]].start,
                position: origin + wide([x, y, z]),
                normal: out * wide(contact.normal),
                depth: contact.depth.into(),
                area: contact.area.into(),
                pressure: f64::from(push).max(0.0),
            }
        };
        Ok(contacts.iter().filter(|contact| contact.stiffness > 0.0).map(point).collect())
    }
}
