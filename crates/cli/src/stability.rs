//! `palpate stability`: runs stiff and extreme cases, which vary one parameter at a time, checks that each case keeps
//! certain invariants, prints the report, and writes it.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use palpate::{Error, Result};
use palpate_bench::stability::{self, Settings, axes};

use crate::report::{Output, measured};
use crate::watch;

/// Options of `palpate stability`.
#[derive(clap::Args)]
#[command(
    after_help = "Exit status: 4 if a case fails without raising a flag, if a scene is refused, or if a case with \
    usual parameters (1 kPa to 10 MPa, Poisson's ratio 0 to 0.49, steps of 0.25 to 10 ms; the report marks such cases) \
    does not pass; else 0"
)]
pub struct Arguments {
    /// Test fewer values of each parameter, with fewer steps
    #[arg(long)]
    quick: bool,
    /// Also do a million steps of resting contact, which takes half an hour
    #[arg(long)]
    soak: bool,
    /// Vary only these parameters, separated by commas: young, poisson, step, thrust and so on; a wrong name is
    /// answered with a list of all names
    #[arg(long, value_name = "AXIS", value_delimiter = ',', value_parser = axis_name)]
    only: Vec<String>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write report.html and results.json into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the cases, writes the report into a directory, if one is given, and prints it. Errors: an invariant is broken
/// without a warning flag, a case's scene is refused, or a case with usual parameters, which must pass, does not.
pub fn stability(arguments: &Arguments) -> Result<()> {
    let settings = Settings {
        is_quick: arguments.quick,
        is_soak: arguments.soak,
        only: arguments.only.clone(),
        device: arguments.device.clone(),
        replaced: Vec::new(),
    };
    let output = arguments.out.as_deref().map(Output::create).transpose()?;
    let results = stability::run(&settings, &mut watch)?;
    let document = stability::document(&results);
    measured::publish(output, &results, &document)?;
    let faults = results.faults();
    if faults.is_empty() { Ok(()) } else { Err(Error::Simulation(in_short(&faults))) }
}

/// One line with the number of faults and the first few faults.
fn in_short(faults: &[String]) -> String {
    let cases = if faults.len() == 1 { "case fails" } else { "cases fail" };
    format!("{} {cases} that must not: {}", faults.len(), measured::first_few(faults))
}

fn axis_name(text: &str) -> std::result::Result<String, String> {
    let known = axes::NAMES.contains(&text);
    if known { Ok(text.into()) } else { Err(format!("not a parameter; give some of: {}", axes::NAMES.join(", "))) }
}
