//! Surfaces that the engine generates, so that a scene needs no mesh file for them: their names, and their possible
//! numbers of vertices. The module `crate::prepare` generates the surfaces.

use std::ops::RangeInclusive;

/// A surface that the engine generates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// A human head, 0.25 m tall, upright along +y, looking towards +z.
    Head,
    /// A pumpkin, 0.3 m across, with the stem at its top, towards +y.
    Pumpkin,
    /// A spur gear with a tip radius of 0.05 m and a bore; its axis is the z axis.
    Gear,
    /// A standing human, 1.7 m tall, upright along +y, arms held out, looking towards +z, the soles at y = 0.
    Human,
    /// A sphere of radius 1 m.
    Sphere,
}

impl Model {
    /// All models.
    pub const ALL: [Model; 5] = [Model::Head, Model::Pumpkin, Model::Gear, Model::Human, Model::Sphere];

    /// Name of the model in a scene file.
    pub fn name(self) -> &'static str {
        match self {
            Model::Head => "head",
            Model::Pumpkin => "pumpkin",
            Model::Gear => "gear",
            Model::Human => "human",
            Model::Sphere => "sphere",
        }
    }

    /// Number of vertices, if a scene does not give this number.
    pub fn default_vertices(self) -> usize {
        match self {
            Model::Head => 44_000,
            Model::Pumpkin => 30_000,
            Model::Gear => 29_000,
            Model::Human => 13_000,
            Model::Sphere => 2_500,
        }
    }

    /// Allowed range of the number of vertices: with fewer vertices the shape is lost, and with more the preparation
    /// takes minutes and gigabytes of memory.
    pub fn vertices(self) -> RangeInclusive<usize> {
        match self {
            Model::Head => 500..=400_000,
            Model::Pumpkin => 500..=400_000,
            Model::Gear => 2_000..=400_000,
            Model::Human => 2_000..=400_000,
            Model::Sphere => 100..=400_000,
        }
    }
}
