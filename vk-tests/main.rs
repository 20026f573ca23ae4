//! Tests of kernels and whole steps on a real Vulkan device, with validation and synchronisation validation on. It is a
//! failure if there is no device. PALPATE_TEST_DEVICE chooses one (index, or part of a name).

mod gpu;
mod harness;
mod invariant;
mod scene;
mod solver;
mod stage;
