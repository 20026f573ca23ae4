//! The contact patches of the last step as rectangles to display. A contact patch is an area with one normal where a
//! pair of bodies may touch. A contact is a skin vertex (vertex of a body's surface mesh) inside the other body; rays
//! along the normal give its depth. Collision proxies are convex hulls that cover a body's skin.

use glam::DVec3;

use super::super::{ContactPoint, Simulation};
use crate::Result;
use crate::prepare::Shape;
use crate::shaders::ContactPatch;
use crate::stages::PAIR_PATCHES;

/// A contact patch of the last step: its normal, along which depth is measured, and the rectangle across the normal
/// that both bodies cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPatchRectangle {
    /// Indices of the two bodies; the normal points from the first to the second. The index after that of the last body
    /// is the tool's.
    pub bodies: [usize; 2],
    /// Centre of the rectangle, world, m.
    pub centre: DVec3,
    /// Normal of the patch, unit, world axes.
    pub normal: DVec3,
    /// Directions of the rectangle's sides: unit vectors, world axes, perpendicular to the normal and to each other.
    pub tangents: [DVec3; 2],
    /// Half the extent of the rectangle along each tangent, m.
    pub half: [f64; 2],
    /// Number of those contacts of the two bodies whose normal is nearer to the normal of this patch than to the
    /// normals of the bodies' other patches.
    pub contacts: usize,
}

fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from(x.map(f64::from))
}

impl Simulation {
    /// One rectangle for each contact patch that the last step used, and one for each half-space that a body touches.
    /// Along the patch's normal, a rectangle lies at the mean position of the patch's contacts. If there are none, it
    /// lies at the collision proxies of the body that has the smaller extent along the normal, at their outermost point
    /// towards the other body. This function reads a few numbers back from the GPU.
    #[doc(hidden)]
    pub fn contact_patch_rectangles(&self) -> Result<Vec<ContactPatchRectangle>> {
        if self.step == 0 {
            return Ok(Vec::new());
        }
        let (contact_patches, _) = self.touch()?;
        let contacts = self.contacts()?;
        let mut squares = Vec::new();
        for (pair, [a, b]) in self.model.pair_bodies.iter().copied().enumerate() {
            let both = |c: &&ContactPoint| c.bodies == [a, b] || c.bodies == [b, a];
            let own: Vec<&ContactPoint> = contacts.iter().filter(both).collect();
            if let Some(plane) = self.model.pair_planes[pair] {
                // The half-space's normal points out of it, towards the body that touches it.
                squares.extend(of_plane([a, b], -plane.normal, &own));
                continue;
            }
            let active: Vec<&ContactPatch> = contact_patches[PAIR_PATCHES * pair..][..PAIR_PATCHES]
                .iter()
                .filter(|contact_patch| contact_patch.weight > 0.0)
                .collect();
            for (k, contact_patch) in active.iter().enumerate() {
                let normal_of = |c: &ContactPoint| if c.bodies[0] == a { -c.normal } else { c.normal };
                let nearest = |c: &ContactPoint| {
                    let along = |r: &ContactPatch| wide(r.normal).dot(normal_of(c));
                    let best = (0..active.len()).max_by(|i, j| along(active[*i]).total_cmp(&along(active[*j])));
                    best == Some(k)
                };
                let held: Vec<DVec3> = own.iter().filter(|c| nearest(c)).map(|c| c.position).collect();
                squares.push(self.rectangle_of([a, b], contact_patch, &held));
            }
        }
        Ok(squares)
    }

    fn rectangle_of(
        &self,
        bodies: [usize; 2],
        contact_patch: &ContactPatch,
        contacts: &[DVec3],
    ) -> ContactPatchRectangle {
        let (normal, tangents) =
            (wide(contact_patch.normal), [wide(contact_patch.tangent), wide(contact_patch.bitangent)]);
        let column = |k: usize| [contact_patch.low[k], contact_patch.high[k]].map(f64::from);
        let middle = [column(0), column(1)].map(|[low, high]| 0.5 * (low + high));
        let half = [column(0), column(1)].map(|[low, high]| 0.5 * (high - low));
        let across = self.step_origin + middle[0] * tangents[0] + middle[1] * tangents[1];
        let height = match contacts.len() {
            0 => self.facing(bodies, normal),
            count => contacts.iter().map(|x| normal.dot(*x)).sum::<f64>() / count as f64,
        };
        let centre = across + (height - normal.dot(across)) * normal;
        ContactPatchRectangle { bodies, centre, normal, tangents, half, contacts: contacts.len() }
    }

    /// Greatest coordinate along the normal that body a's proxies reach, m, if body a is the body with the smaller
    /// extent along the normal; otherwise the least that body b's proxies reach. The normal points from body a to body
    /// b.
    fn facing(&self, [a, b]: [usize; 2], normal: DVec3) -> f64 {
        let range = |body: usize| {
            let heights = self.hull_corners(body).into_iter().map(|x| normal.dot(x));
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
        };
        let (of_a, of_b) = (range(a), range(b));
        if of_a.1 - of_a.0 < of_b.1 - of_b.0 { of_a.1 } else { of_b.0 }
    }

    /// Corners of a body's collision proxies, world, m.
    fn hull_corners(&self, body: usize) -> Vec<DVec3> {
        let Some(owner) = self.bodies.iter().chain(&self.tool_body).nth(body) else { return Vec::new() };
        let (Shape::Soft { proxies, .. } | Shape::Rigid { proxies, .. }) = &owner.shape else { return Vec::new() };
        let place = |proxy: &crate::prepare::Proxy| -> Vec<DVec3> {
            let frame = (self.model.body_frames[body] + proxy.frame) as usize;
            let centre = self.model.frames[frame].rest_centre;
            let world = |x: &DVec3| match &self.tool {
                Some(tool) if self.model.tool_frame == Some(frame) => tool.centre + tool.orientation * (*x - centre),
                _ => self.frames.world(frame, *x - centre),
            };
            proxy.hull.iter().map(world).collect()
        };
        proxies.iter().flat_map(place).collect()
    }
}

/// The rectangle around a body's contacts with a half-space, if there are any contacts.
fn of_plane(bodies: [usize; 2], normal: DVec3, contacts: &[&ContactPoint]) -> Option<ContactPatchRectangle> {
    if contacts.is_empty() {
        return None;
    }
    let (u, v) = normal.any_orthonormal_pair();
    let tangents = [u, v];
    let mean = contacts.iter().map(|c| c.position).sum::<DVec3>() / contacts.len() as f64;
    let range = |t: DVec3| {
        let along = contacts.iter().map(|c| t.dot(c.position));
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    };
    let ranges = tangents.map(range);
    let half = ranges.map(|(low, high)| 0.5 * (high - low));
    let centre = tangents
        .iter()
        .zip(ranges)
        .fold(normal.dot(mean) * normal, |sum, (t, (low, high))| sum + 0.5 * (low + high) * *t);
    Some(ContactPatchRectangle { bodies, centre, normal, tangents, half, contacts: contacts.len() })
}
