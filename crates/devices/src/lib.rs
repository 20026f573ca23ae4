//! Haptic devices, real and simulated, for the haptic loop of palpate (the thread that reads a device and commands a
//! force to it about 1000 times a second). A session, one run of the loop with a device, can be recorded and replayed.

pub mod callback;
#[cfg(test)]
mod closed_loop;
#[cfg(test)]
mod faults;
pub mod hand;
pub mod haply;
pub mod mouse;
pub mod record;
pub mod replay;
mod replayed;
pub mod resolution;
pub mod safety_check;
pub mod scripted;
#[cfg(test)]
mod several;
#[cfg(test)]
mod steady;
// Its hardware is read on Linux alone.
#[cfg_attr(not(target_os = "linux"), allow(dead_code))]
pub mod steered;
#[allow(unsafe_code)]
pub mod vendor;

pub use callback::Callback;
pub use hand::{Hand, HandEnergy, HandParameters};
pub use haply::Haply;
pub use mouse::Mouse;
pub use replayed::Replay;
pub use scripted::Scripted;
pub use steered::Steered;
pub use vendor::{ForceDimension, Touch};
