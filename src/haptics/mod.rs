//! The hand's side, in f64 on the host: devices, the tool that the hand holds by virtual coupling, and the loop that plays
//! its force a thousand times a second.

pub mod clock;
pub mod coupling;
pub mod device;
pub mod environment;
pub mod event;
pub mod follow;
pub mod local_model;
pub mod pace;
pub mod passivity;
pub mod safety;
pub mod sense;
pub mod servo;
pub mod servo_thread;
pub mod session;
pub mod velocity;
pub mod virtual_time;

pub use device::{Device, Fault, Reading};
