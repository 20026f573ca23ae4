//! `palpate bench`: runs the benchmarks, prints their report, and writes the report and every measured sample. A
//! benchmark consists of parts, which are measured one by one; a *shard* is a subset of the parts of all benchmarks.
//! The command also joins the results of shards that were measured separately, and compares results with earlier ones.

use std::path::{Path, PathBuf};

use clap::builder::NonEmptyStringValueParser;
use palpate::{Error, Result};
use palpate_bench::accuracy::{self, Accuracy};
use palpate_bench::compare::{self, Verdict};
use palpate_bench::features::{self, Features};
use palpate_bench::haptics::{self, Haptics};
use palpate_bench::paper::{self, Paper};
use palpate_bench::proximity::{self, Proximity};
use palpate_bench::solver::{self, Solver};
use palpate_bench::suite::{self, Head, Shard};
use palpate_bench::{Benchmark, Results};

use crate::report::{Output, measured};
use crate::{print, watch};

/// Options of `palpate bench`.
#[derive(clap::Args)]
pub struct Arguments {
    /// What to measure: a benchmark (`solver`), a part of a benchmark (`solver/scaling`), or the beginning of names of
    /// parts up to a dash (`solver/human` selects all `solver/human-*`) [default: everything]
    names: Vec<String>,
    /// Measure fewer cases and sizes, with fewer runs and steps, for a first look
    #[arg(long)]
    quick: bool,
    /// List the parts that would be measured, and measure nothing
    #[arg(long)]
    list: bool,
    /// Measure only shard I of N: the I-th part and every N-th part after it
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,
    /// Measure nothing; join the results of the shards that were written into these directories
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["names", "quick", "shard", "list", "device"])]
    merge: Vec<PathBuf>,
    /// Compare with these earlier results; exit with status 4 if anything is slower or less accurate beyond noise
    #[arg(long, value_name = "OLD.json")]
    compare: Option<PathBuf>,
    /// Folder of the scene files that the benchmark `paper` runs
    #[arg(long, value_name = "DIR", default_value = "assets/scenes")]
    scenes: PathBuf,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write report.html and results.json into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn shard(text: &str) -> std::result::Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)));
    match parts {
        Some((index, count)) if (1..=count).contains(&index) => Ok(Shard { index: index - 1, count }),
        _ => Err("give the number of the shard and how many there are, such as 1/4".into()),
    }
}

/// Every benchmark, in the order of the report.
fn benchmarks(arguments: &Arguments) -> Vec<Box<dyn Benchmark>> {
    let device = || arguments.device.clone();
    let proximity = if arguments.quick { proximity::Settings::quick() } else { proximity::Settings::full() };
    let solver = if arguments.quick { solver::Settings::quick() } else { solver::Settings::full() };
    let haptics = if arguments.quick { haptics::Settings::quick() } else { haptics::Settings::full() };
    let paper = if arguments.quick { paper::Settings::quick() } else { paper::Settings::full() };
    let paper = paper::Settings { scenes: arguments.scenes.clone(), device: device(), ..paper };
    let accuracy = if arguments.quick { accuracy::Settings::quick() } else { accuracy::Settings::full() };
    let features = if arguments.quick { features::Settings::quick() } else { features::Settings::full() };
    vec![
        Box::new(Paper(paper)),
        Box::new(Proximity(proximity::Settings { device: device(), ..proximity })),
        Box::new(Solver(solver::Settings { device: device(), ..solver })),
        Box::new(Haptics(haptics::Settings { device: device(), ..haptics })),
        Box::new(Accuracy(accuracy::Settings { device: device(), ..accuracy })),
        Box::new(Features(features::Settings { device: device(), ..features })),
    ]
}

/// Measures, or joins the results of shards; then writes the results, prints them and compares them with earlier ones.
/// Errors, returned only after all this: a part failed, a result is outside its bounds, or a measurement became worse.
pub fn bench(arguments: &Arguments) -> Result<()> {
    let benchmarks = benchmarks(arguments);
    let asked = asked(&arguments.names, &benchmarks)?;
    if arguments.list {
        return print(&asked.iter().map(|(name, part)| format!("{name}/{part}\n")).collect::<String>());
    }
    // Earlier results are read first, so that a wrong path is an error before minutes are spent on measuring.
    let old = arguments.compare.as_deref().map(results_in).transpose()?;
    let output = arguments.out.as_deref().map(Output::create).transpose()?;
    output.as_ref().map_or(Ok(()), |output| output.reserve(&[measured::RESULTS]))?;
    let (results, mut failed) = if arguments.merge.is_empty() {
        let head = Head::new(arguments.device.as_deref(), arguments.quick)?;
        let is_asked = |name: &str, part: &str| asked.iter().any(|(n, p)| *n == name && p == part);
        suite::measure(&benchmarks, head, arguments.shard.unwrap_or(Shard::WHOLE), &is_asked, &mut watch)?
    } else {
        let shards = arguments.merge.iter().map(|dir| Ok((dir.as_path(), results_in(dir)?)));
        (suite::merge(shards.collect::<Result<_>>()?)?, Vec::new())
    };
    let document = suite::document(&benchmarks, &results, old.as_ref())?;
    measured::publish(output, &results, &document)?;
    failed.extend(suite::faults(&benchmarks, &results)?);
    if let Some(old) = old {
        failed.extend(compared(&old, &results)?);
    }
    if failed.is_empty() { Ok(()) } else { Err(Error::Simulation(failed.join("; "))) }
}

/// All pairs of benchmark and part that the names on the command line select. Errors: a name that selects nothing.
fn asked(names: &[String], benchmarks: &[Box<dyn Benchmark>]) -> Result<Vec<(&'static str, String)>> {
    let mut all: Vec<(&'static str, String)> = Vec::new();
    for benchmark in benchmarks {
        all.extend(benchmark.parts().into_iter().map(|part| (benchmark.name(), part)));
    }
    let calls = |asked: &str, (name, part): &(&'static str, String)| {
        asked == *name
            || asked.strip_prefix(name).and_then(|rest| rest.strip_prefix('/')).is_some_and(|asked| {
                part.strip_prefix(asked).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
            })
    };
    if let Some(wrong) = names.iter().find(|asked| !all.iter().any(|part| calls(asked, part))) {
        let known: Vec<&str> = benchmarks.iter().map(|benchmark| benchmark.name()).collect();
        let problem = format!("there is no benchmark or part `{wrong}`");
        let remedy = format!("give {}, or a part that --list shows", known.join(", "));
        return Err(Error::Usage(format!("{problem}; {remedy}")));
    }
    Ok(all.into_iter().filter(|part| names.is_empty() || names.iter().any(|asked| calls(asked, part))).collect())
}

/// Reads results from a directory that `palpate bench --out` wrote, or from a results file.
fn results_in(path: &Path) -> Result<Results> {
    if path.is_dir() { suite::read(&path.join(measured::RESULTS)) } else { suite::read(path) }
}

/// Prints the ratio of the new to the old value of each measurement; returns a line that says how many measurements
/// became worse, if any did. Errors: the two sets of results cannot be compared.
fn compared(old: &Results, new: &Results) -> Result<Option<String>> {
    let (all, lonely) = compare::compare(old, new)?;
    let of = |head: &Head| format!("{} ({}), commit {}", head.device, head.driver, head.commit);
    let machine = |head: &Head| (head.device.clone(), head.driver.clone(), head.threads);
    let elsewhere = match machine(&old.head) == machine(&new.head) {
        true => "",
        false => {
            " They were measured on a DIFFERENT device, driver or number of threads; times mostly differ because of it."
        }
    };
    let count = |verdict| all.iter().filter(|c| c.verdict == verdict).count();
    let (worse, better, unjudged) = (count(Verdict::Worse), count(Verdict::Better), count(Verdict::Unjudged));
    print(&format!(
        "\n# Comparison with earlier results\n\nOld: {}. New: {}.{elsewhere} The ratio of a time is the new \
         median over the old median; where the device is the CPU, the ratio is divided by the change of the CPU's own \
         time for a fixed piece of work. The interval of a ratio extends from the fastest new round (repetition of \
         the measurement) over the slowest old round to the slowest new round over the fastest old round.\n\n{}\n{} \
         of {} measurements are worse beyond noise, {better} are \
         better, {unjudged} have too few samples to judge. Measured only in the old or only in the new results: {}.\n",
        of(&old.head),
        of(&new.head),
        compare::table(&all).markdown(),
        worse,
        all.len(),
        if lonely.is_empty() { "nothing".into() } else { lonely.join(", ") }
    ))?;
    Ok((worse > 0)
        .then(|| format!("{worse} of {} measurements are slower, less accurate or larger than before", all.len())))
}
