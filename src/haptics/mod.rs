//! The hand's side, in f64 on the host: devices, the tool that the hand holds by virtual coupling, and the loop that plays
//! its force a thousand times a second.

pub mod device;
pub mod devices;
pub mod drive;
pub mod profile;
pub mod tool;
pub mod velocity;

pub use device::{Device, Fault, Reading, RigidState, Wrench};
pub use profile::Profile;
