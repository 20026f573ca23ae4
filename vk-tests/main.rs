//! Kernels on a real device, held against expectations. Validation and synchronisation validation are on; no device is
//! a failure. Choose one with PALPATE_TEST_DEVICE (index, or part of a name).

mod gpu;
mod harness;
mod law;
mod scene;
mod solver;
mod stage;
