//! Surfaces with an exact number of vertices that the engine generates itself, so that scenes need no files.
//!
//! Head, pumpkin, human and sphere are solids given by signed distance functions, whose surfaces are extracted and then
//! reduced by edge collapse; the gear is built from its profile. The models are bitwise the same on every machine, because
//! they are computed with correctly rounded operations and with the trigonometric functions of `libm` only.

pub mod collapse;
pub mod extract;
mod gear;
mod head;
mod human;
mod pumpkin;
pub mod solid;
mod sphere;
mod split;
#[cfg(test)]
mod tests;

use glam::DVec3;

use crate::scene::Model;

/// Vertices (m) and triangles of a model's surface with exactly `vertex_count` vertices, which must be within
/// [`Model::vertices`]. The surface is closed, manifold, oriented outwards and in one piece, of genus 0 (the gear: 1).
pub fn surface(model: Model, vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    match model {
        Model::Head => head::head(vertex_count),
        Model::Pumpkin => pumpkin::pumpkin(vertex_count),
        Model::Gear => gear::gear(vertex_count),
        Model::Human => human::human(vertex_count),
        Model::Sphere => sphere::sphere(vertex_count),
    }
}

/// A solid, and the parameters for extracting its surface.
struct Blank<S> {
    /// Approximate signed distance function, m, negative inside.
    solid: S,
    /// Least and greatest corner of a box that contains the solid, m.
    bounds: [DVec3; 2],
    /// A point inside the solid, m.
    inside: DVec3,
    /// Product of the number of vertices that marching tetrahedra give for this solid and the square of the lattice's
    /// cell edge, m^2; it hardly depends on the cell edge.
    vertices_per_cell: f64,
    /// Greatest cell edge of the lattice, m. The thinnest parts of the solid are about this thick, and a coarser
    /// lattice might miss these parts.
    coarsest: f64,
}

/// Number of vertices that are extracted for each vertex of the final surface. Edge collapse removes the surplus, and
/// with it the slivers of marching tetrahedra.
const SURPLUS: f64 = 2.0;

impl<S: Fn(DVec3) -> f64> Blank<S> {
    /// Vertices and triangles of the surface with exactly `vertex_count` vertices.
    fn surface(&self, vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut cell = (self.vertices_per_cell / (SURPLUS * vertex_count as f64)).sqrt().min(self.coarsest);
        loop {
            let (mut vertices, triangles) = extract::surface(&self.solid, self.bounds, self.inside, cell);
            if vertices.len() > vertex_count {
                extract::smooth(&self.solid, &mut vertices, &triangles, 2);
                let (mut vertices, triangles) = collapse::to_count(vertices, triangles, vertex_count);
                extract::smooth(&self.solid, &mut vertices, &triangles, 6);
                return (vertices, triangles);
            }
            cell *= 0.8;
        }
    }
}
