//! Tests of single kernels against f64, with a file for each kernel or group of kernels.

pub mod candidates;
pub mod chunks;
pub mod contact;
pub mod contact_patches;
pub mod contact_sizes;
pub mod cull;
pub mod draw;
pub mod elastic;
pub mod fields;
pub mod flow;
pub mod frames;
pub mod gap;
pub mod mean_dilatation;
pub mod meet;
pub mod overflows;
pub mod overlays;
pub mod panel;
pub mod paths;
pub mod pose;
pub mod ray_hits;
pub mod reach;
pub mod response;
pub mod skin;
pub mod sort;
pub mod view;
pub mod wrench;
