//! Devices, real and simulated.
