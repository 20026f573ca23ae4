//! Devices, real and simulated.

pub mod callback;
pub mod hand;
pub mod scripted;

pub use callback::Callback;
pub use hand::{Hand, HandEnergy, HandParameters};
pub use scripted::Scripted;
