//! The haptic side of the engine, in f64 on the CPU: the interface of haptic devices, and the loop that commands a
//! force to the device, usually a thousand times a second. The device leads the *tool*, a rigid body, through a virtual
//! coupling (spring and damper).

pub mod clock;
pub mod compliance;
pub mod coupling;
pub mod device;
pub mod environment;
pub mod event;
pub mod follow;
pub mod local_model;
pub mod pace;
pub mod passivity;
pub mod prediction;
pub mod safety;
pub mod sense;
pub mod servo;
pub mod servo_thread;
pub mod session;
pub mod velocity;
pub mod virtual_time;
mod walls;

pub use device::{Device, Fault, Reading};
