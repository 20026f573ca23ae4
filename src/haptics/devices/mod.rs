//! Devices, real and simulated.

pub mod callback;
pub mod hand;
pub mod haply;
pub mod mouse;
mod replay;
pub mod scripted;

pub use callback::Callback;
pub use hand::{Hand, HandEnergy, HandParameters};
pub use haply::Haply;
pub use mouse::Mouse;
pub use replay::Replay;
pub use scripted::Scripted;
