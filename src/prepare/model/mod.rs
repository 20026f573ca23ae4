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

use std::ops::RangeInclusive;

use glam::DVec3;

/// A model that the engine makes by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// A head, 0.25 m tall, looking towards +z.
    Head,
    /// A pumpkin, 0.3 m across, stem up.
    Pumpkin,
    /// A spur gear of tip radius 0.05 m about z, with a bore.
    Gear,
    /// A standing human, 1.7 m tall, arms held out, looking towards +z, the soles at y = 0.
    Human,
}

impl Model {
    /// Every model.
    pub const ALL: [Model; 4] = [Model::Head, Model::Pumpkin, Model::Gear, Model::Human];

    /// Its name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Model::Head => "head",
            Model::Pumpkin => "pumpkin",
            Model::Gear => "gear",
            Model::Human => "human",
        }
    }

    /// Vertices where a scene does not say.
    pub fn default_vertices(self) -> usize {
        match self {
            Model::Head => 44_000,
            Model::Pumpkin => 30_000,
            Model::Gear => 29_000,
            Model::Human => 13_000,
        }
    }

    /// Numbers of vertices that make sense: fewer lose the shape, more take minutes and gigabytes.
    pub fn vertices(self) -> RangeInclusive<usize> {
        match self {
            Model::Head => 500..=400_000,
            Model::Pumpkin => 500..=400_000,
            Model::Gear => 2_000..=400_000,
            Model::Human => 2_000..=400_000,
        }
    }

    /// The surface with exactly `vertex_count` vertices (m; within [`Model::vertices`]) and its triangles: closed,
    /// manifold, outward, one piece, genus 0 (the gear 1).
    pub fn surface(self, vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        match self {
            Model::Head => head::head(vertex_count),
            Model::Pumpkin => pumpkin::pumpkin(vertex_count),
            Model::Gear => gear::gear(vertex_count),
            Model::Human => human::human(vertex_count),
        }
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
