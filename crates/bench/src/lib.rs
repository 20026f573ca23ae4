//! The benchmarks of `palpate bench`, the stability matrix of `palpate stability`, and the reports made from them. Each
//! benchmark has a module of its own; all benchmarks share the code that measures and merges their parts (`suite`),
//! collects samples, draws plots, and writes reports.

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
