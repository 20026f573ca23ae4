//! `palpate diff`: compares two runs by their traces (`trace.csv`) and by the series that `palpate run --export` writes.
//! A difference is that of a vector or a tensor as a whole, and is told as a share of the greatest one of the first run; of
//! a position, as a share of the greatest distance from where it began (in a grid, from the first point); of a rotation,
//! as a share of half a turn. What only one of the runs has, or has in another shape, is a difference too.

mod fields;
mod trace;

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

use palpate::internal::files::extension;
use palpate::{Error, Result};
use palpate_page::plot::{Axis, Line, lines};
use serde::Serialize;

use crate::report::Output;
use crate::{print, tell};

/// Least length that differences of lengths are told as a share of, m: what moves by less is as good as at rest, and would
/// be measured against rounding.
const LEAST_WAY: f64 = 1e-6;
/// Most lines of a plot.
const MOST_LINES: usize = 6;

/// Options of `palpate diff`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The first run: a directory that `palpate run --out` or `--export` wrote, a trace, or a .pvd file
    a: PathBuf,
    /// The second run, of the same kind
    b: PathBuf,
    /// Greatest difference that is allowed, as a share of the greatest value of the first run; exit with status 4 if
    /// there is a greater one
    #[arg(long, value_name = "X", default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    tolerance: f64,
    /// Directory to write diff.json and the plot diff.svg into
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn share(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number >= 0.0 && number.is_finite());
    number.ok_or_else(|| "give a number that is not negative, such as 1e-3".into())
}

/// How a quantity differs between two runs.
#[derive(Debug, Default, Serialize)]
pub struct Difference {
    /// What it is, such as `force` or `block-layer von_mises_stress`.
    quantity: String,
    unit: &'static str,
    /// Greatest difference.
    greatest: f64,
    /// Time of it, s.
    time_s: f64,
    /// Root of the mean square of the differences over moments, and over points or cells.
    rms: f64,
    /// Greatest value in the first run: what the difference is told as a share of.
    of: f64,
    /// Time (s) of each moment, and the greatest difference then.
    #[serde(skip)]
    curve: Vec<(f64, f64)>,
    #[serde(skip)]
    squares: f64,
    #[serde(skip)]
    count: usize,
}

impl Difference {
    fn new(quantity: impl Into<String>, unit: &'static str) -> Difference {
        Difference { quantity: quantity.into(), unit, ..Difference::default() }
    }

    /// Takes the values of a moment: for each point or cell the difference, and the value in the first run.
    fn add(&mut self, time: f64, values: impl Iterator<Item = (f64, f64)>) {
        let mut greatest = 0.0f64;
        for (difference, value) in values {
            // What is not a number, or too large for its square to be one, differs from everything.
            let difference = if difference.is_finite() { difference } else { f64::INFINITY };
            greatest = greatest.max(difference);
            self.of = if value.is_finite() { self.of.max(value) } else { self.of };
            self.squares += difference * difference;
            self.count += 1;
        }
        if greatest > self.greatest {
            (self.greatest, self.time_s) = (greatest, time);
        }
        self.curve.push((time, greatest));
    }

    fn done(mut self) -> Difference {
        self.rms = (self.squares / self.count.max(1) as f64).sqrt();
        if self.unit == "m" {
            self.of = self.of.max(LEAST_WAY);
        }
        self
    }

    /// The greatest difference as a share of the greatest value; infinite where that is zero.
    fn share(&self) -> f64 {
        if self.greatest == 0.0 { 0.0 } else { self.greatest / self.of }
    }
}

/// What there is to say of a comparison besides numbers.
#[derive(Default)]
pub struct Findings {
    /// How the runs were compared.
    notes: Vec<String>,
    /// What could not be compared, since only one of the runs has it, or has it in another shape.
    unmatched: Vec<String>,
}

/// Compares two runs.
pub fn diff(arguments: &Arguments) -> Result<()> {
    let (mut all, mut findings) = (Vec::new(), Findings::default());
    let traces = [trace_of(&arguments.a), trace_of(&arguments.b)];
    match &traces {
        [Some(a), Some(b)] => all.extend(trace::compare(a, b, &mut findings)?),
        [None, None] => {}
        _ => findings.unmatched.push("only one of the runs has a trace.csv".into()),
    }
    let series = [series_of(&arguments.a)?, series_of(&arguments.b)?];
    let are_files = arguments.a.is_file() && arguments.b.is_file();
    for (name, a) in &series[0] {
        match series[1].iter().find(|(other, _)| other == name || are_files) {
            Some((_, b)) => all.extend(fields::compare(name, a, b, &mut findings)?),
            None => findings.unmatched.push(format!("only the first run has the series {name}")),
        }
    }
    for (name, _) in series[1].iter().filter(|(name, _)| !are_files && series[0].iter().all(|(other, _)| other != name))
    {
        findings.unmatched.push(format!("only the second run has the series {name}"));
    }
    if all.is_empty() {
        let [a, b] = [&arguments.a, &arguments.b].map(|path| path.display());
        let remedy = "give two directories with a trace.csv or with .pvd files of the same names, or two such files";
        return Err(Error::Usage(format!("{a} and {b} have nothing to compare: {remedy}")));
    }
    findings.notes.iter().chain(&findings.unmatched).for_each(|note| tell(note));
    if let Some(folder) = &arguments.out {
        let mut output = Output::create(folder)?;
        output.write("diff.json", |w| serde_json::to_writer_pretty(w, &all).map_err(Into::into))?;
        let svg = plot(&all)?;
        output.write("diff.svg", |w| w.write_all(svg.as_bytes()))?;
        output.commit()?;
    }
    let is_equal = all.iter().all(|one| one.share() == 0.0) && findings.unmatched.is_empty();
    print(&format!("{}{}", Table(&all), if is_equal { "no difference was found in what was compared\n" } else { "" }))?;
    let worst = all.iter().max_by(|a, b| a.share().total_cmp(&b.share()));
    match worst.filter(|worst| worst.share() > arguments.tolerance) {
        None if findings.unmatched.is_empty() => Ok(()),
        None => {
            let count = findings.unmatched.len();
            Err(Error::Simulation(format!("the runs differ in what they have: {count} of the notes tell where")))
        }
        Some(worst) => Err(Error::Simulation(format!(
            "the runs differ: {} by {:.3e} of its greatest value, at {:?} s; allowed is {:e}",
            worst.quantity,
            worst.share(),
            worst.time_s,
            arguments.tolerance
        ))),
    }
}

/// The trace that a path means.
fn trace_of(path: &Path) -> Option<PathBuf> {
    let file = if path.is_dir() { path.join("trace.csv") } else { path.to_path_buf() };
    (extension(&file) == "csv" && file.exists()).then_some(file)
}

/// Names and files of the series that a path means.
fn series_of(path: &Path) -> Result<Vec<(String, PathBuf)>> {
    let files = if path.is_dir() {
        let entries = std::fs::read_dir(path).map_err(|error| {
            Error::input(path, None, format!("cannot be read: {error}"), "give a directory of results")
        })?;
        let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        files.sort();
        files
    } else if path.exists() {
        vec![path.into()]
    } else {
        return Err(Error::input(path, None, "does not exist", "give a directory of results, a trace or a .pvd file"));
    };
    let series = files.into_iter().filter(|file| extension(file) == "pvd");
    Ok(series.map(|file| (file.file_stem().unwrap_or_default().to_string_lossy().into_owned(), file)).collect())
}

/// Differences over time of the quantities that differ most.
fn plot(all: &[Difference]) -> Result<String> {
    let mut shown: Vec<&Difference> = all.iter().filter(|difference| difference.of > 0.0).collect();
    shown.sort_by(|a, b| b.share().total_cmp(&a.share()));
    let line = |difference: &&Difference| Line {
        name: difference.quantity.clone(),
        // What is infinite cannot be drawn; the table tells it.
        points: difference
            .curve
            .iter()
            .map(|(time, greatest)| (*time, greatest / difference.of))
            .filter(|(_, share)| share.is_finite())
            .collect(),
        ranges: Vec::new(),
    };
    let drawn: Vec<Line> = shown.iter().take(MOST_LINES).map(line).collect();
    lines(&Axis { label: "time, s".into(), names: Vec::new() }, "difference, as a share of the greatest value", &drawn)
}

/// The differences as a table.
struct Table<'a>(&'a [Difference]);

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let width = self.0.iter().map(|difference| difference.quantity.len()).max().unwrap_or(0).max(8);
        writeln!(
            f,
            "{:width$} {:>11} {:>11} {:>11} {:>10} {:>9}  unit",
            "quantity", "greatest", "rms", "of", "share", "at, s"
        )?;
        for d in self.0 {
            let (quantity, unit, share) = (&d.quantity, d.unit, d.share());
            writeln!(
                f,
                "{quantity:width$} {:>11.3e} {:>11.3e} {:>11.3e} {share:>10.2e} {:>9.4}  {unit}",
                d.greatest, d.rms, d.of, d.time_s
            )?;
        }
        Ok(())
    }
}
