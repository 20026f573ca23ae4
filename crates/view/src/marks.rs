//! Meshes of arrows, rods and rectangles, which the CPU makes for each rendered image to mark forces and places.

use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use palpate::internal::gpu::{Buffer, Memory};
use palpate::{Context, Result};

use super::pieces::Arrays;

/// Number of sides of cylinders and cones.
const SIDES: u32 = 20;
/// Length and radius of an arrow's head, in radii of its shaft.
const HEAD: [f64; 2] = [6.0, 2.6];

/// A triangle mesh with a normal at each vertex; positions, m, are relative to `origin`.
#[derive(Debug, Clone)]
pub struct Marks {
    origin: DVec3,
    positions: Vec<[f32; 4]>,
    normals: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Marks {
    pub fn new(origin: DVec3) -> Marks {
        Marks { origin, positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() }
    }

    /// Adds an arrow from one point to another, with a shaft of this radius (m); returns the range of the arrow's
    /// indices, which is empty if the points coincide.
    pub fn arrow(&mut self, from: DVec3, to: DVec3, radius: f64) -> Range<u32> {
        let length = from.distance(to);
        let first = self.index_count();
        if let Some(axis) = (to - from).try_normalize() {
            // A short arrow is a smaller head without a shaft.
            let radius = radius.min(length / HEAD[0]);
            let neck = to - HEAD[0] * radius * axis;
            self.cone([from, neck], [radius; 2]);
            self.cone([neck, to], [HEAD[1] * radius, 0.0]);
            self.ring(from, -axis, [0.0, radius]);
            self.ring(neck, -axis, [radius, HEAD[1] * radius]);
        }
        first..self.index_count()
    }

    /// Adds a rod of this radius (m) from one point to another; returns the range of the rod's indices.
    pub fn rod(&mut self, from: DVec3, to: DVec3, radius: f64) -> Range<u32> {
        let first = self.index_count();
        if from != to {
            self.cone([from, to], [radius; 2]);
        }
        first..self.index_count()
    }

    /// Adds both sides of a rectangle whose edges are twice the vectors `half` (m); returns the range of its indices.
    pub fn rectangle(&mut self, centre: DVec3, half: [DVec3; 2]) -> Range<u32> {
        let first = self.index_count();
        let [u, v] = half;
        let corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
        let normal = u.cross(v).normalize_or_zero();
        for (normal, order) in [(normal, [0, 1, 2, 0, 2, 3]), (-normal, [0, 2, 1, 0, 3, 2])] {
            let corner = corners.map(|x| self.vertex(x, normal));
            self.triangles.push([corner[order[0]], corner[order[1]], corner[order[2]]]);
            self.triangles.push([corner[order[3]], corner[order[4]], corner[order[5]]]);
        }
        first..self.index_count()
    }

    fn index_count(&self) -> u32 {
        3 * self.triangles.len() as u32
    }

    fn vertex(&mut self, x: DVec3, normal: DVec3) -> u32 {
        self.positions.push((x - self.origin).as_vec3().extend(1.0).to_array());
        self.normals.push(normal.as_vec3().extend(0.0).to_array());
        self.positions.len() as u32 - 1
    }

    /// Adds the lateral surface of a truncated cone between two circles with these centres and radii, m.
    fn cone(&mut self, ends: [DVec3; 2], radii: [f64; 2]) {
        let along = ends[1] - ends[0];
        let Some(axis) = along.try_normalize() else { return };
        let (u, v) = axis.any_orthonormal_pair();
        let rise = (radii[0] - radii[1]) / along.length();
        let first = self.positions.len() as u32;
        for k in 0..SIDES {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
            let out = cos * u + sin * v;
            let normal = (out + rise * axis).normalize();
            for end in 0..2 {
                self.vertex(ends[end] + radii[end] * out, normal);
            }
        }
        for k in 0..SIDES {
            let [a, b] = [first + 2 * k, first + 2 * ((k + 1) % SIDES)];
            self.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }

    /// Adds a flat ring between two circles with these radii (m), the inner radius first.
    fn ring(&mut self, centre: DVec3, normal: DVec3, radii: [f64; 2]) {
        let (u, v) = normal.any_orthonormal_pair();
        let first = self.positions.len() as u32;
        for k in 0..SIDES {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
            for radius in radii {
                self.vertex(centre + radius * (cos * u + sin * v), normal);
            }
        }
        for k in 0..SIDES {
            let [a, b] = [first + 2 * k, first + 2 * ((k + 1) % SIDES)];
            self.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }

    /// Uploads the mesh to the GPU; `None` if it is empty.
    pub fn upload(&self, context: &Arc<Context>) -> Result<Option<Arrays>> {
        if self.triangles.is_empty() {
            return Ok(None);
        }
        let values = vec![0f32; self.positions.len().next_multiple_of(4)];
        Ok(Some(Arrays {
            positions: Buffer::from_slice(context, "positions", &self.positions, Memory::Upload)?,
            normals: Buffer::from_slice(context, "normals", &self.normals, Memory::Upload)?,
            values: Buffer::from_slice(context, "values", &values, Memory::Upload)?,
            indices: Buffer::from_slice(context, "triangles", &self.triangles, Memory::Upload)?,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every triangle's winding agrees with its corners' normals, and an arrow encloses the volume of shaft and head.
    #[test]
    fn arrows_are_closed_and_face_outwards() {
        let mut marks = Marks::new(DVec3::new(5.0, 0.0, 0.0));
        let range = marks.arrow(DVec3::new(5.0, 1.0, 0.0), DVec3::new(5.0, 1.0, 2.0), 0.05);
        assert_eq!(range, 0..3 * marks.triangles.len() as u32);
        let point = |list: &[[f32; 4]], i: u32| {
            let [x, y, z, _] = list[i as usize].map(f64::from);
            DVec3::new(x, y, z)
        };
        let mut volume = 0.0;
        for t in &marks.triangles {
            let [a, b, c] = t.map(|i| point(&marks.positions, i));
            let face = (b - a).cross(c - a);
            let mean: DVec3 = t.iter().map(|i| point(&marks.normals, *i)).sum();
            assert!(face.length() < 1e-12 || face.dot(mean) > 0.0, "face normal {face} against corner normals {mean}");
            volume += a.dot(b.cross(c)) / 6.0;
        }
        let circle = std::f64::consts::PI * 0.05 * 0.05;
        let expected = circle * (2.0 - 0.3) + circle * HEAD[1] * HEAD[1] * 0.3 / 3.0;
        assert!((volume / expected - 1.0).abs() < 0.05, "volume {volume} m^3, expected {expected} m^3");
        assert!(marks.arrow(DVec3::ZERO, DVec3::ZERO, 0.1).is_empty(), "between equal points no arrow is added");
    }
}
