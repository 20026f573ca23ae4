//! Models made by the engine itself, so that scenes need no files: surfaces with an exact number of vertices.
//!
//! Head, pumpkin and human are solids as signed distances, their surfaces extracted and collapsed; the gear is built
//! from its profile. Bit for bit the same everywhere: only correctly rounded operations, and sines from `libm`.

pub mod collapse;
pub mod extract;
mod gear;
mod head;
mod human;
mod pumpkin;
pub mod solid;
mod split;
#[cfg(test)]
mod tests;

use glam::DVec3;

use crate::scene::Model;

/// The surface of a model with exactly `vertex_count` vertices (m; within [`Model::vertices`]) and its triangles: closed,
/// manifold, outward, one piece, genus 0 (the gear 1).
pub fn surface(model: Model, vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    match model {
        Model::Head => head::head(vertex_count),
        Model::Pumpkin => pumpkin::pumpkin(vertex_count),
        Model::Gear => gear::gear(vertex_count),
        Model::Human => human::human(vertex_count),
    }
}

/// What a surface is made from.
struct Blank<S> {
    /// Negative inside.
    solid: S,
    /// Corners of a box that holds the solid, m.
    bounds: [DVec3; 2],
    /// A point inside.
    inside: DVec3,
    /// Vertices that marching tetrahedra give per (1 m / cell)^2 of this solid.
    vertices_per_cell: f64,
    /// Coarsest lattice, m: the thinnest parts are about this thick, and a coarser one could pierce them.
    coarsest: f64,
}

/// Vertices extracted for each one wanted: collapsing then removes the slivers of marching tetrahedra.
const SURPLUS: f64 = 2.0;

impl<S: Fn(DVec3) -> f64> Blank<S> {
    /// The surface with exactly `vertex_count` vertices.
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
