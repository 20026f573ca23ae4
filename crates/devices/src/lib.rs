//! Haptic devices, real and simulated, for the haptic loop of `palpate`; and recordings of sessions with them, which
//! can be replayed.

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
pub mod scripted;
#[cfg(test)]
mod steady;

pub use callback::Callback;
pub use hand::{Hand, HandEnergy, HandParameters};
pub use haply::Haply;
pub use mouse::Mouse;
pub use replayed::Replay;
pub use scripted::Scripted;
