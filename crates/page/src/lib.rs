//! Pages and plots of reports: a report is one HTML file with its plots inside, without scripts and without references
//! to other files. The benchmarks write a [`Document`]; `palpate run` composes its page from the pieces in [`page`].

pub mod document;
pub mod page;
pub mod plot;
pub mod reduce;

pub use document::{Chapter, Document, Section, Table};
pub use reduce::Reduced;
