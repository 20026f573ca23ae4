//! `palpate selftest`: whether a Vulkan device computes what it should, and what it costs.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use palpate::{Error, Options, Result};
use palpate_bench::selftest;

use crate::report::Output;
use crate::{print, watch};

const RESULTS: &str = "selftest.json";
const PAGE: &str = "selftest.html";

/// Options of `palpate selftest`.
#[derive(clap::Args)]
#[command(after_help = "Exit status: 4 if a scene, a repeated run or a choice that must not matter gives other forces")]
pub struct Arguments {
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Number of invocations in a workgroup of GPU kernels whose invocations synchronise, a power of two from 8 to 256
    /// [default: the environment variable PALPATE_WORKGROUP; else one subgroup on a CPU, 128 elsewhere]
    #[arg(long, value_name = "N")]
    workgroup: Option<u32>,
    /// Directory to write selftest.html and selftest.json into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the self-test, writes its page into a directory, if one is given, and prints it.
pub fn selftest(arguments: &Arguments) -> Result<()> {
    let program = Options::of_program();
    let workgroup = arguments.workgroup.or(program.workgroup);
    let options = Options { device: arguments.device.clone(), workgroup, ..program };
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let results = selftest::run(&options, &mut watch)?;
    let document = selftest::document(&results);
    if let Some(output) = &mut output {
        output.write(RESULTS, |w| serde_json::to_writer_pretty(w, &results).map_err(Into::into))?;
        output.write(PAGE, |w| w.write_all(document.html().as_bytes()))?;
    }
    output.map_or(Ok(()), Output::commit)?;
    print(&document.markdown())?;
    let faults = results.faults();
    if faults.is_empty() { Ok(()) } else { Err(Error::Simulation(faults.join("; "))) }
}
