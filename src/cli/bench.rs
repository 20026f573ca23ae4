//! `palpate bench`: measures, prints the report, and writes it with plots and raw samples.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use clap::ValueEnum;
use clap::builder::NonEmptyStringValueParser;
use palpate::Result;
use palpate::bench::proximity::{self, Settings};
use palpate::report::Output;

use crate::print;

const RESULTS: &str = "results.json";
const REPORT: &str = "proximity.md";

/// Options of `palpate bench`.
#[derive(clap::Args)]
pub struct Arguments {
    /// What to measure [default: everything]
    names: Vec<Name>,
    /// Fewer sizes, runs and steps: a first look in less than a minute
    #[arg(long)]
    quick: bool,
    /// Directory of the scenes to run
    #[arg(long, value_name = "DIR", default_value = "assets/scenes")]
    scenes: PathBuf,
    /// Vulkan device, by name or by index in `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write report, plots and samples into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// A benchmark.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Name {
    /// The query: its time against mesh size, against contact area, against peers, and in the paper's scenes
    Proximity,
}

/// Runs the benchmarks that are named, or all.
pub fn bench(arguments: &Arguments) -> Result<()> {
    if arguments.names.is_empty() || arguments.names.contains(&Name::Proximity) {
        proximity(arguments)?;
    }
    Ok(())
}

fn proximity(arguments: &Arguments) -> Result<()> {
    let settings = if arguments.quick { Settings::quick() } else { Settings::full() };
    let settings = Settings { scenes: arguments.scenes.clone(), device: arguments.device.clone(), ..settings };
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let results = proximity::run(&settings, &mut watch)?;
    let document = proximity::document(&results)?;
    if let Some(output) = &mut output {
        output.write(RESULTS, |w| serde_json::to_writer(w, &results).map_err(Into::into))?;
        for (name, svg) in document.sections.iter().filter_map(|section| section.plot.as_ref()) {
            output.write(name, |w| w.write_all(svg.as_bytes()))?;
        }
        output.write(REPORT, |w| w.write_all(document.markdown(true).as_bytes()))?;
    }
    output.map_or(Ok(()), Output::commit)?;
    print(&document.markdown(false))
}

/// What is under way, for whoever waits at a terminal.
fn watch(what: &str) {
    let mut stderr = std::io::stderr();
    if stderr.is_terminal() {
        // A closed stderr does not stop a measurement.
        drop(writeln!(stderr, "{what}"));
    }
}
