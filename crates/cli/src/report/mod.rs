//! The files and tables that runs of scenes and queries (searches for the overlap of two surfaces) write: a trace with
//! a row per step, summaries, images, and a directory that appears complete or not at all.

pub mod curves;
pub mod felt;
pub mod field;
pub mod figure;
pub mod haptics;
mod letters;
pub mod measured;
pub mod output;
pub mod page;
pub mod picture;
pub mod query;
pub mod summary;
pub mod trace;

pub use output::Output;
pub use query::QueryReport;
pub use summary::{Facts, Plan, StageSamples, Summary, Tally};
pub use trace::{Names, Trace};
