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
mod loads;
pub mod mean_dilatation;
pub mod meet;
pub mod overflows;
pub mod overlaps;
pub mod overlays;
pub mod panel;
pub mod paths;
pub mod pose;
pub mod ray_hits;
pub mod reach;
pub mod response;
pub mod skin;
pub mod sort;
pub mod stresses;
pub mod view;
pub mod wrench;

use crate::harness::context;

/// Numbers of elements: 0, 1, three numbers around the width of a workgroup, and a large number.
fn sizes() -> [usize; 6] {
    let width = context().group_size() as usize;
    [0, 1, width - 1, width, width + 1, 1234]
}
