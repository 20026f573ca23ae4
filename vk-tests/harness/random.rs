//! Pseudo-random numbers for test cases, the same in every run.

use glam::{DQuat, DVec3};

/// A linear congruential generator (Knuth's MMIX constants). Its field is the state, which starts with the seed.
pub struct Random(pub u64);

impl Random {
    /// The next number, in [-1, 1).
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A vector of three numbers in [-1, 1).
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }

    /// A rotation whose rotation vector has random components between -`reach` and `reach`, rad.
    pub fn turn(&mut self, reach: f64) -> DQuat {
        DQuat::from_scaled_axis(reach * self.vector())
    }

    /// A random index from 0 to `n` - 1.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next() * 0.5 + 0.5) * n as f64) as usize
    }
}
