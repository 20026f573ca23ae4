//! The stages of the step: a file a stage, each with its kernels, its arrays and a `record` that reads like DESIGN's list.

pub mod args;
pub mod model;
pub mod types;
