//! Devices, real and simulated.

pub mod haply;
