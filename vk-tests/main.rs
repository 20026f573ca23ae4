//! Tests of kernels and whole steps on a real Vulkan device, with validation and synchronisation validation on. The
//! tests fail if there is no device. The environment variable PALPATE_TEST_DEVICE chooses one (its index, or a part of
//! its name).

mod gpu;
mod harness;
mod invariant;
mod scene;
mod solver;
mod stage;
