//! The error that a depth texture would cause, computed in f64 on the CPU. Contact depths as in the paper of Galoppo
//! and others (2007), from heights of both skins (surface meshes) sampled at the centres of texels, are compared with
//! depths found by exact rays, which the engine uses.

use glam::DVec3;
use palpate_oracle::rays::Rays;
use palpate_oracle::skin;

/// Two skins in one pose, and the direction from the first to the second.
#[derive(Clone, Copy)]
pub struct Pose<'a> {
    /// The skin at whose vertices depths are found: positions (m), triangles, and the area that each vertex represents
    /// (m^2).
    pub first: (&'a [DVec3], &'a [[u32; 3]], &'a [f64]),
    /// The other skin: positions (m), triangles.
    pub second: (&'a [DVec3], &'a [[u32; 3]]),
    /// Unit direction from the first skin to the second.
    pub normal: DVec3,
}

impl Pose<'_> {
    /// Volume of the overlap, m^3, with the depth at each vertex of the first skin found by a ray of its own: the sum
    /// of depth times projected area, which is the force of a penalty contact divided by its stiffness.
    pub fn exact(&self) -> f64 {
        let rays = Rays::new(self.normal, self.second.0, self.second.1);
        self.sum(|x| self.depth(&rays, x))
    }

    /// Volume of the overlap, m^3, with depths looked up in texels of edge `texel` (m). The depth at a vertex is the
    /// overlap of the skins on the line along the normal through the centre of the vertex's texel.
    pub fn sampled(&self, texel: f64) -> f64 {
        let above = Rays::new(self.normal, self.first.0, self.first.1);
        let below = Rays::new(-self.normal, self.second.0, self.second.1);
        let tangents = self.normal.any_orthonormal_pair();
        // Rays start so far away that they meet both skins from outside.
        let off = 2.0 * self.first.0.iter().chain(self.second.0).map(|x| x.length()).fold(0.0, f64::max) * self.normal;
        self.sum(|x| {
            let middle = |t: DVec3| ((x.dot(t) / texel).floor() + 0.5) * texel * t;
            let foot = middle(tangents.0) + middle(tangents.1);
            match (above.first(foot + off), below.first(foot - off)) {
                (Some(top), Some(bottom)) => 2.0 * off.length() - top.depth - bottom.depth,
                _ => 0.0,
            }
        })
    }

    fn depth(&self, rays: &Rays, x: DVec3) -> f64 {
        rays.first(x).filter(|ray_hit| ray_hit.leaves).map_or(0.0, |ray_hit| ray_hit.depth)
    }

    fn sum(&self, depth: impl Fn(DVec3) -> f64) -> f64 {
        let (positions, triangles, areas) = self.first;
        let normals = skin::normals(positions, triangles);
        let facing = positions.iter().zip(&normals).zip(areas);
        let share = |((x, m), area): ((&DVec3, &DVec3), &f64)| {
            let projected = area * m.dot(self.normal).max(0.0);
            if projected > 0.0 { projected * depth(*x).max(0.0) } else { 0.0 }
        };
        facing.map(share).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::space::shapes::{ball, block_skin};

    #[test]
    fn the_overlap_of_a_ball_and_a_block_is_a_cap_and_texels_tend_to_it() {
        let (radius, depth) = (0.02, 0.003);
        let (mut vertices, triangles) = ball(radius, 48, 2.0);
        vertices.iter_mut().for_each(|x| x.y += radius - depth);
        let areas = skin::areas(&vertices, &triangles);
        let (block, faces) = block_skin(DVec3::splat(0.05), [1, 1, 1], DVec3::ZERO);
        let first = (&vertices[..], &triangles[..], &areas[..]);
        let pose = Pose { first, second: (&block, &faces), normal: DVec3::NEG_Y };
        let cap = std::f64::consts::PI * depth * depth * (radius - depth / 3.0);
        let exact = pose.exact();
        assert!((exact / cap - 1.0).abs() < 0.01, "overlap: {exact} m^3; spherical cap: {cap} m^3");
        let error = |texel: f64| (pose.sampled(texel) / exact - 1.0).abs();
        let errors = [0.008, 0.002, 0.0001].map(error);
        assert!(
            errors[0] > 0.02 && errors[1] < 0.5 * errors[0] && errors[2] < 0.2 * errors[1],
            "relative errors with texels of 8, 2 and 0.1 mm: {errors:?}"
        );
        // Skins at a distance from each other have no overlap.
        let up: Vec<DVec3> = vertices.iter().map(|x| *x + 0.01 * DVec3::Y).collect();
        let apart = Pose { first: (&up, &triangles, &areas), ..pose };
        assert_eq!((apart.exact(), apart.sampled(0.001)), (0.0, 0.0));
    }
}
