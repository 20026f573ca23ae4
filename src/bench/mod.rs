//! Benchmarks, and the reports made by them. Each has a folder of its own; they share samples, plots and the way that
//! questions, tables and findings are set.

pub mod accuracy;
pub mod document;
pub mod haptics;
pub mod plot;
pub mod proximity;
pub mod samples;
pub mod solver;

pub use document::{Document, Section, Table};
pub use samples::{Samples, median};

/// Version of the format of `results.json`: raised when a field changes its meaning or goes.
pub const SCHEMA: u32 = 2;
