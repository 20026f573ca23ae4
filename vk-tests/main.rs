//! Kernels on a real device, held against expectations. Validation and synchronisation validation are on; no device is
//! a failure. Choose one with PALPATE_TEST_DEVICE (index, or part of a name).

mod energy;
mod gpu;
mod harness;
mod harness_self_test;
mod heads;
mod laws;
mod touch;
mod whole_step;
