//! Fits values of a scene, such as Young's modulus, to a measured curve of force over time or over indentation, by
//! nonlinear least squares.
//!
//! [`Measured`] is the curve, [`Free`] a value to be fitted, [`fit`] does it. Each trial is a whole simulation, so the
//! fit is made to need few of them.

mod measured;
mod simulated;
mod solve;
mod students_t;

pub use measured::{Abscissa, Measured};
pub use solve::{Estimate, Fit, Free, Verdict, fit};
