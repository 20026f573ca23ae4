//! Devices, real and simulated.

mod replay;

pub use replay::Replay;
