//! The Vulkan room: devices, kernels, pictures, and the layouts that Rust and shaders share.

pub mod canvas;
pub mod device;
pub mod replaced;
pub mod variants;
