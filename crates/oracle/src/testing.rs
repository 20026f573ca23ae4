//! Small meshes and pseudo-random numbers for the tests.

use glam::DVec3;
use palpate::internal::prepare::{Layer, layer};

/// Boundary triangles of a layer (tetrahedral mesh), as node indices.
pub fn boundary(layer: &Layer) -> Vec<[u32; 3]> {
    layer::boundary_faces(&layer.tetrahedra).into_iter().map(|(triangle, _)| triangle).collect()
}

/// Pseudo-random numbers in [-1, 1], generated from a seed.
pub struct Random(pub u64);

impl Random {
    /// Returns the next number.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Returns a vector of three numbers.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}
