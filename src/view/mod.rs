//! What is seen: where one looks from, the picture, and the simulation that goes on beside it. No window: whoever opens one
//! (`palpate view`) or writes files (`palpate film`) stands on this.

pub mod camera;
mod decimate;
pub mod live;
mod look;
mod moment;
pub mod overlay;
pub mod painter;
mod parts;
pub mod picture;
mod renderer;
pub mod turns;

pub use camera::Camera;
pub use moment::Moment;
pub use renderer::{Renderer, Settings};
