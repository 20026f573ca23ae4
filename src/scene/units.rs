//! Units of length in which mesh files give their coordinates.

use super::{Body, Tool};

/// The names of units in scene files, and their lengths, m.
pub const UNITS: [(&str, f64); 4] = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("in", 0.0254)];

impl Body {
    /// Metres for each unit of file coordinates: the length of the unit times the scale.
    pub fn metres(&self) -> f64 {
        self.units.unwrap_or(1.0) * self.scale
    }
}

impl Tool {
    /// Metres for each unit of file coordinates: the length of the unit times the scale.
    pub fn metres(&self) -> f64 {
        self.units.unwrap_or(1.0) * self.scale
    }
}
