//! Tests of the Vulkan module (`palpate::internal::gpu`): GPU devices, kernels (compute shaders) and their variants,
//! drawing onto images.

pub mod canvas;
pub mod device;
pub mod faults;
pub mod replaced;
pub mod variants;
