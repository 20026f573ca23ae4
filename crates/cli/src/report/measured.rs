//! What `palpate bench`, `stability` and `validate` do with what they measured: results and their report are written,
//! the report is printed, and faults end the program with one line.

use std::io::Write;

use palpate::Result;
use palpate_bench::Document;
use serde::Serialize;

use super::Output;
use crate::print;

/// File of the results in the directory of the output.
pub const RESULTS: &str = "results.json";
/// File of the report there.
const REPORT: &str = "report.html";
/// Number of faults that a closing error names; the report lists all.
const TOLD: usize = 3;

/// Writes results and their report, if there is an output, and prints the report.
pub fn publish(output: Option<Output>, results: &impl Serialize, document: &Document) -> Result<()> {
    if let Some(mut output) = output {
        output.write(RESULTS, |w| serde_json::to_writer(w, results).map_err(Into::into))?;
        output.write(REPORT, |w| w.write_all(document.html().as_bytes()))?;
        output.commit()?;
    }
    print(&document.markdown())
}

/// The first few faults, in one line.
pub fn first_few(faults: &[String]) -> String {
    let first = faults[..faults.len().min(TOLD)].join("; ");
    let more = if faults.len() > TOLD { "; the report lists the others" } else { "" };
    format!("{first}{more}")
}
