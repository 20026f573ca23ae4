//! What is seen: where one looks from, the picture, and the simulation that goes on beside it. No window: whoever opens one
//! (`palpate view`) or writes files (`palpate film`) stands on this.

pub mod camera;
mod decimate;
mod labels;
pub mod live;
pub mod look;
mod marks;
mod moment;
pub mod overlay;
pub mod painter;
mod parts;
pub mod picture;
mod pieces;
mod renderer;
pub mod scale;
mod studio;
pub mod tessellated;
pub mod turns;

pub use camera::Camera;
pub use labels::Labels;
pub use look::map;
pub use moment::Moment;
pub use overlay::{Overlay, Overlays};
pub use renderer::{Legend, Renderer, Settings};
pub use studio::Studio;
