//! The benchmarks of `palpate bench`, the stability matrix of `palpate stability`, the cases of `palpate validate`, and
//! the reports made from them. Each benchmark has a module of its own; they share the code that measures and merges
//! their parts (`suite`), collects samples, and writes reports by the crate palpate-page.

pub mod accuracy;
pub mod compare;
pub mod features;
pub mod fit;
mod gauge;
pub mod haptics;
mod limit;
pub mod meshes;
pub mod paper;
pub mod proximity;
pub mod samples;
pub mod selftest;
pub mod solver;
pub mod stability;
pub mod suite;
pub mod validation;

pub use palpate_page::{Chapter, Document, Section, Table, document};
pub(crate) use palpate_page::{page, plot};
pub use samples::{Samples, median};
pub use suite::{Benchmark, Results, SCHEMA};
