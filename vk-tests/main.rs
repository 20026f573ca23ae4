//! Kernels on a real device, held against expectations. Validation and synchronisation validation are on; no device is
//! a failure. Choose one with PALPATE_TEST_DEVICE (index, or part of a name).

mod bodies;
mod bones;
mod contact;
mod contact_sizes;
mod cull;
mod deep;
mod depth;
mod dirty;
mod elastic;
mod energy;
mod extremes;
mod flow;
mod frames;
mod gpu;
mod harness;
mod harness_self_test;
mod heads;
mod laws;
mod layers;
mod layouts;
mod paths;
mod pose;
mod random;
mod regions;
mod skin;
mod solve;
mod spheres;
mod system;
mod touch;
mod transpose;
mod whole_step;
mod wrench;
