//! Kernels on a real device, held against expectations. Validation and synchronisation validation are on; no device is
//! a failure. Choose one with PALPATE_TEST_DEVICE (index, or part of a name).

mod elastic;
mod gpu;
mod harness;
mod harness_self_test;
mod solve;
mod system;
mod whole_step;
mod wrench;
