//! Surfaces that the engine generates, so that they need no file: their names, and their possible numbers of vertices.
//! The module `crate::prepare` generates them.

use std::ops::RangeInclusive;

/// A surface that the engine generates.
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
    /// All models.
    pub const ALL: [Model; 4] = [Model::Head, Model::Pumpkin, Model::Gear, Model::Human];

    /// Name of the model in a scene file.
    pub fn name(self) -> &'static str {
        match self {
            Model::Head => "head",
            Model::Pumpkin => "pumpkin",
            Model::Gear => "gear",
            Model::Human => "human",
        }
    }

    /// Number of vertices if a scene gives none.
    pub fn default_vertices(self) -> usize {
        match self {
            Model::Head => 44_000,
            Model::Pumpkin => 30_000,
            Model::Gear => 29_000,
            Model::Human => 13_000,
        }
    }

    /// Range of the number of vertices: with fewer the shape is lost; more take minutes and gigabytes to prepare.
    pub fn vertices(self) -> RangeInclusive<usize> {
        match self {
            Model::Head => 500..=400_000,
            Model::Pumpkin => 500..=400_000,
            Model::Gear => 2_000..=400_000,
            Model::Human => 2_000..=400_000,
        }
    }
}
