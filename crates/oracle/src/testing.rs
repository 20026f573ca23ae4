//! Small meshes and numbers for the laws' tests.

use glam::DVec3;
use palpate::internal::prepare::{Layer, layer};

/// A layer's boundary, by node.
pub fn boundary(layer: &Layer) -> Vec<[u32; 3]> {
    layer::boundary_faces(&layer.tetrahedra).into_iter().map(|(triangle, _)| triangle).collect()
}

/// Numbers in [-1, 1], the same every time.
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A vector of three.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}
