//! Rendering of a simulation: the camera, the images, and the thread on which the simulation runs while it is drawn.
//! This crate opens no window itself: `palpate view`, which opens one, and `palpate film`, which writes files, use it.

pub mod camera;
mod decimate;
mod labels;
pub mod live;
pub mod look;
mod marks;
pub mod materials;
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
pub use moment::{Moment, clock};
pub use overlay::{Overlay, Overlays};
pub use renderer::{Legend, Renderer, Settings};
pub use studio::Studio;
