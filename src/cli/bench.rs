//! `palpate bench`: measures, prints the report, and writes it with plots and raw samples.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use clap::builder::NonEmptyStringValueParser;
use palpate::Result;
use palpate::bench::{Document, accuracy, haptics, proximity, solver};
use palpate::report::Output;
use serde::Serialize;

use crate::print;

const RESULTS: &str = "results.json";

/// Options of `palpate bench`.
#[derive(clap::Args)]
pub struct Arguments {
    /// What to measure [default: everything, each into a folder of its own]
    names: Vec<Name>,
    /// Fewer cases, sizes, runs and steps: a first look
    #[arg(long)]
    quick: bool,
    /// Of `proximity`: directory of the scenes to run
    #[arg(long, value_name = "DIR", default_value = "assets/scenes")]
    scenes: PathBuf,
    /// Of `solver`: these cases alone, with commas between them: block10k, block105k, human or scaling; `block10k-2MPa` and
    /// `block10k-2MPa-1ms` are parts of the first
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = case_name)]
    cases: Vec<String>,
    /// Of `accuracy`: these curves alone, with commas between them
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = curve_name)]
    only: Vec<String>,
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
    /// The step without contact: its time against the error that it leaves, against peers, and against mesh size
    Solver,
    /// The loop: how stiff a wall may be, how still a force keeps, how far it jumps, and how punctual its ticks are
    Haptics,
    /// Error against run time: what each knob of a scene buys
    Accuracy,
}

fn case_name(text: &str) -> std::result::Result<String, String> {
    let problem = "is no case; give block10k, block105k, human or scaling, or a part such as block10k-2MPa-1ms";
    if solver::Settings::knows(text) { Ok(text.into()) } else { Err(problem.into()) }
}

fn curve_name(text: &str) -> std::result::Result<String, String> {
    let known: Vec<&str> = accuracy::names().collect();
    if known.contains(&text) { Ok(text.into()) } else { Err(format!("is no curve; give {}", known.join(", "))) }
}

/// Runs the benchmarks that are named, or all.
pub fn bench(arguments: &Arguments) -> Result<()> {
    let is_asked = |name: Name| arguments.names.is_empty() || arguments.names.contains(&name);
    let asked: Vec<Name> = Name::value_variants().iter().copied().filter(|name| is_asked(*name)).collect();
    for name in &asked {
        let folder = match name {
            Name::Proximity => "proximity",
            Name::Solver => "solver",
            Name::Haptics => "haptics",
            Name::Accuracy => "accuracy",
        };
        let out = arguments.out.as_ref().map(|out| if asked.len() > 1 { out.join(folder) } else { out.clone() });
        match name {
            Name::Proximity => proximity(arguments, out.as_deref())?,
            Name::Solver => solver(arguments, out.as_deref())?,
            Name::Haptics => haptics(arguments, out.as_deref())?,
            Name::Accuracy => accuracy(arguments, out.as_deref())?,
        }
    }
    Ok(())
}

fn proximity(arguments: &Arguments, out: Option<&Path>) -> Result<()> {
    use proximity::Settings;
    let settings = if arguments.quick { Settings::quick() } else { Settings::full() };
    let settings = Settings { scenes: arguments.scenes.clone(), device: arguments.device.clone(), ..settings };
    report(out, "proximity.md", || {
        let results = proximity::run(&settings, &mut watch)?;
        Ok((proximity::document(&results)?, results))
    })
}

fn solver(arguments: &Arguments, out: Option<&Path>) -> Result<()> {
    use solver::Settings;
    let settings = if arguments.quick { Settings::quick() } else { Settings::full() };
    let settings = if arguments.cases.is_empty() { settings } else { settings.only(&arguments.cases) };
    let settings = Settings { device: arguments.device.clone(), ..settings };
    report(out, "solver.md", || {
        let results = solver::run(&settings, &mut watch)?;
        Ok((solver::document(&results)?, results))
    })
}

fn haptics(arguments: &Arguments, out: Option<&Path>) -> Result<()> {
    use haptics::Settings;
    let settings = if arguments.quick { Settings::quick() } else { Settings::full() };
    let settings = Settings { device: arguments.device.clone(), ..settings };
    report(out, "haptics.md", || {
        let results = haptics::run(&settings, &mut watch)?;
        Ok((haptics::document(&results)?, results))
    })
}

fn accuracy(arguments: &Arguments, out: Option<&Path>) -> Result<()> {
    use accuracy::Settings;
    let settings = if arguments.quick { Settings::quick() } else { Settings::full() };
    let settings = if arguments.only.is_empty() { settings } else { settings.only(&arguments.only) };
    let settings = Settings { device: arguments.device.clone(), ..settings };
    report(out, "accuracy.md", || {
        let results = accuracy::run(&settings, &mut watch)?;
        Ok((accuracy::document(&results)?, results))
    })
}

/// Measures, writes what was found into a directory, if there is one, and prints it.
fn report<T: Serialize>(out: Option<&Path>, name: &str, run: impl FnOnce() -> Result<(Document, T)>) -> Result<()> {
    let mut output = out.map(Output::create).transpose()?;
    let (document, results) = run()?;
    if let Some(output) = &mut output {
        output.write(RESULTS, |w| serde_json::to_writer(w, &results).map_err(Into::into))?;
        for (name, svg) in document.sections.iter().filter_map(|section| section.plot.as_ref()) {
            output.write(name, |w| w.write_all(svg.as_bytes()))?;
        }
        output.write(name, |w| w.write_all(document.markdown(true).as_bytes()))?;
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
