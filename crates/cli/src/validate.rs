//! `palpate validate`: computes values that others published, prints the report, and writes it.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use palpate::{Error, Result};
use palpate_bench::validation::{self, Settings, cases};

use crate::report::{Output, measured};
use crate::{print, watch};

/// Options of `palpate validate`.
#[derive(clap::Args)]
#[command(
    after_help = "Exit status: 4 if a published value is not reproduced within the bound that the report explains, \
    or a case cannot be run to its end; else 0"
)]
pub struct Arguments {
    /// Use fewer and coarser meshes
    #[arg(long)]
    quick: bool,
    /// List the cases with their sources, and compute nothing
    #[arg(long, conflicts_with_all = ["quick", "device", "out"])]
    list: bool,
    /// Run only these cases, separated by commas, by their names in the list
    #[arg(long, value_name = "CASE", value_delimiter = ',', value_parser = case_name)]
    only: Vec<String>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write report.html and results.json into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the cases, writes the report into a directory, if one is given, and prints it. Errors: a published value is not
/// reproduced, or a case fails.
pub fn validate(arguments: &Arguments) -> Result<()> {
    let settings = Settings {
        is_quick: arguments.quick,
        only: arguments.only.clone(),
        device: arguments.device.clone(),
        replaced: Vec::new(),
    };
    if arguments.list {
        return print(
            &settings
                .cases()
                .map(|case| format!("{}: {}. {}\n", case.name, case.title, case.source))
                .collect::<String>(),
        );
    }
    let output = arguments.out.as_deref().map(Output::create).transpose()?;
    let results = validation::run(&settings, &mut watch)?;
    let document = validation::document(&results)?;
    measured::publish(output, &results, &document)?;
    let faults = results.faults();
    match faults.len() {
        0 => Ok(()),
        count => {
            let few = measured::first_few(&faults);
            Err(Error::Simulation(format!("{count} not reproduced: {few}")))
        }
    }
}

fn case_name(text: &str) -> std::result::Result<String, String> {
    let names: Vec<&str> = cases::ALL.iter().map(|case| case.name).collect();
    let problem = || format!("not a case; give some of: {}", names.join(", "));
    names.contains(&text).then(|| text.into()).ok_or_else(problem)
}
