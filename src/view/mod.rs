//! What is seen: where one looks from, the picture, and the simulation that goes on beside it. No window: whoever opens one
//! (`palpate view`) or writes files (`palpate film`) stands on this.

pub mod camera;
pub mod live;
pub mod turns;
