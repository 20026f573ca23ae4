//! Benchmarks, and the reports made by them. Each has a folder of its own; they share the way that parts are measured and
//! joined, samples, plots, and the way that questions, tables and findings are set.

pub mod accuracy;
pub mod compare;
pub mod document;
pub mod features;
pub mod fit;
mod gauge;
pub mod haptics;
pub mod meshes;
pub(crate) mod page;
pub mod paper;
pub mod plot;
pub mod proximity;
pub mod samples;
pub mod solver;
pub mod stability;
pub mod suite;

pub use document::{Chapter, Document, Section, Table};
pub use samples::{Samples, median};
pub use suite::{Benchmark, Results, SCHEMA};
