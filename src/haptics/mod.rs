//! The hand's side, in f64 on the host: where the device is, and the tool that it holds by virtual coupling.

pub mod drive;
pub mod tool;
