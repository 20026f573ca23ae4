//! The code that all benchmarks share. A benchmark is measured part by part, so that a sweep (run of many parts) can be
//! divided into shards (subsets of the parts, for several machines) and merged again. The report is made from
//! `results.json` alone.

use std::path::Path;

use palpate::internal::files;
use palpate::internal::gpu::DeviceKind;
use palpate::internal::query::choice::Choice;
use palpate::{Context, Error, Options, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::gauge::gauge;
use super::samples::hands;
use super::{Chapter, Document, Section};

/// Version of the format of `results.json`: raised when a field changes its meaning or is removed.
pub const SCHEMA: u32 = 5;

/// Exit status of an error while running; lower statuses are errors of the input or a missing device.
const FAILED: u8 = 4;

/// A benchmark: its parts, which are measured one by one, and the report of the parts that were measured.
pub trait Benchmark {
    /// Name on the command line and in `results.json`.
    fn name(&self) -> &'static str;
    /// Heading of the benchmark's chapter in the report.
    fn title(&self) -> &'static str;
    /// The benchmark's settings, for `results.json`. Errors: they cannot be written as JSON.
    fn settings(&self) -> Result<Value>;
    /// Names of the benchmark's parts, in the order of the report. Measurements that are compared with each other
    /// belong to one part, in which they are run alternately.
    fn parts(&self) -> Vec<String>;
    /// Measures a part; `watch` is called with the name of each piece of work as it begins. Errors: there is no device,
    /// the device fails, or the input is bad.
    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value>;
    /// How the benchmark was measured, for the report; computed from its settings.
    fn preface(&self, settings: &Value) -> Result<String>;
    /// The report's sections on the parts that were measured.
    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>>;
    /// The report's sections on the parts that were measured, with those of earlier results beside them where the
    /// benchmark can show both in one plot. Errors: the parts cannot be read.
    fn compared(&self, parts: &Map<String, Value>, _earlier: &Map<String, Value>) -> Result<Vec<Section>> {
        self.sections(parts)
    }
    /// Requirements that the measured parts do not meet, one line for each requirement. Errors: the parts cannot be
    /// read.
    fn faults(&self, _parts: &Map<String, Value>) -> Result<Vec<String>> {
        Ok(Vec::new())
    }
}

/// A subset of all parts: the part at `index` and every `count`-th one after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Index of the first part, from 0 to `count` - 1.
    pub index: usize,
    /// Number of shards, at least 1.
    pub count: usize,
}

impl Shard {
    /// The shard that contains all parts.
    pub const WHOLE: Shard = Shard { index: 0, count: 1 };
}

/// The program and the machine of a measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// Version of the format, [`SCHEMA`].
    pub schema: u32,
    /// Version of palpate.
    pub version: String,
    /// The git commit that palpate was built from, with `-changed` if the sources differed from it; `unknown` outside a
    /// repository.
    pub commit: String,
    /// Name of the GPU device.
    pub device: String,
    /// Name and version of the GPU driver.
    pub driver: String,
    /// Depth path that this device uses by default: the implementation, compute or graphics, of the depth stage, which
    /// is the part of a step that finds how deep bodies overlap.
    pub depth_path: String,
    /// Whether the GPU device is the CPU itself (a software driver).
    pub is_cpu: bool,
    /// Number of hardware threads of the machine.
    pub threads: usize,
    /// Whether this is the short form of the benchmarks (`--quick`).
    pub is_quick: bool,
}

/// The contents of `results.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Results {
    /// Program and machine.
    #[serde(flatten)]
    pub head: Head,
    /// Measurements of each benchmark, by its name.
    pub benchmarks: Map<String, Value>,
}

/// Measurements of a benchmark in `results.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Measured {
    settings: Value,
    /// Names of all parts of the benchmark, measured or not.
    names: Vec<String>,
    parts: Map<String, Value>,
    /// Times of a fixed piece of work before and after each part was measured, us: see [`super::gauge`].
    gauges: Map<String, Value>,
}

impl Results {
    /// Times of a fixed piece of work directly before and after a part (such as `solver/scaling`) was measured, us, as
    /// medians of interleaved subsets (see [`hands`]). `None`: the times were not recorded, or the GPU device is not
    /// the CPU, on which that work was done.
    pub fn gauge(&self, part: &str) -> Option<Vec<f64>> {
        let (benchmark, part) = part.split_once('/')?;
        let samples = self.benchmarks.get(benchmark)?.get("gauges")?.get(part)?;
        let hands = hands(&[samples.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?]);
        (self.head.is_cpu && !hands.is_empty()).then_some(hands)
    }
}

impl Head {
    /// The head for this program and a GPU device, by name or index. Errors: there is no such device.
    pub fn new(device: Option<&str>, is_quick: bool) -> Result<Head> {
        let context = Context::open(&Options { device: device.map(Into::into), ..Options::of_program() })?;
        Ok(Head {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION").into(),
            commit: env!("PALPATE_COMMIT").into(),
            device: context.device_name().into(),
            driver: context.driver().into(),
            depth_path: Choice::new(&context, None)?.path.name().into(),
            is_cpu: context.kind() == DeviceKind::Cpu,
            threads: std::thread::available_parallelism().map_or(1, Into::into),
            is_quick,
        })
    }

    fn preface(&self) -> String {
        let Head { version, commit, device, driver, depth_path, threads, is_quick, .. } = self;
        let quick = if *is_quick { " This is a quick run, for a first look only." } else { "" };
        format!(
            "Measured by palpate {version} (commit {commit}) on {device} ({driver}), a machine of {threads} threads; \
             the depth stage runs by {depth_path}.{quick}"
        )
    }
}

/// Measures, one after the other, the parts of a shard that `is_asked` selects by benchmark and part. Returns the
/// results, and the errors of the parts that failed: a failure does not lose the other results.
pub fn measure(
    benchmarks: &[Box<dyn Benchmark>],
    head: Head,
    shard: Shard,
    is_asked: &dyn Fn(&str, &str) -> bool,
    watch: &mut dyn FnMut(&str),
) -> Result<(Results, Vec<String>)> {
    let (mut all, mut failed) = (Map::new(), Vec::new());
    let mut turn = 0;
    for benchmark in benchmarks {
        let name = benchmark.name();
        let names: Vec<String> = benchmark.parts().into_iter().filter(|part| is_asked(name, part)).collect();
        let (mut parts, mut gauges) = (Map::new(), Map::new());
        for part in &names {
            if turn % shard.count == shard.index {
                watch(&format!("{name}: {part}"));
                let before = gauge();
                match benchmark.measure(part, watch) {
                    Ok(measured) => {
                        parts.insert(part.clone(), measured);
                        gauges.insert(part.clone(), to_value(&[before, gauge()].concat())?);
                    }
                    // An error of the input or a missing device affects all parts and ends the run.
                    Err(error) if error.exit_status() < FAILED => return Err(error),
                    Err(error) => failed.push(format!("{name}/{part}: {error}")),
                }
            }
            turn += 1;
        }
        if !names.is_empty() {
            let measured = Measured { settings: benchmark.settings()?, names, parts, gauges };
            all.insert(name.into(), to_value(&measured)?);
        }
    }
    Ok((Results { head, benchmarks: all }, failed))
}

/// The report of all that was measured, with the chapters in the order of `benchmarks`.
pub fn document(benchmarks: &[Box<dyn Benchmark>], results: &Results, earlier: Option<&Results>) -> Result<Document> {
    let mut preface = results.head.preface();
    if let Some(Head { device, driver, commit, .. }) = earlier.map(|earlier| &earlier.head) {
        preface += &format!(" What is called `before` was measured earlier: {device} ({driver}), commit {commit}.");
    }
    let mut document = Document { title: "palpate: benchmarks".into(), preface, chapters: vec![] };
    for benchmark in benchmarks {
        let Some(measured) = results.benchmarks.get(benchmark.name()) else { continue };
        let Measured { settings, names, parts, .. } = from_value(measured)?;
        let missing: Vec<&str> = names.iter().map(String::as_str).filter(|name| !parts.contains_key(*name)).collect();
        let mut preface = benchmark.preface(&settings)?;
        if !missing.is_empty() {
            preface += &format!(" Not measured, or not merged yet: {}.", missing.join(", "));
        }
        let before = earlier.and_then(|earlier| earlier.benchmarks.get(benchmark.name()));
        let sections = match before.map(from_value::<Measured>).transpose()? {
            Some(before) => benchmark.compared(&parts, &before.parts)?,
            None => benchmark.sections(&parts)?,
        };
        document.chapters.push(Chapter { title: benchmark.title().into(), preface, sections });
    }
    Ok(document)
}

/// Requirements that the measured parts do not meet, one line for each requirement.
pub fn faults(benchmarks: &[Box<dyn Benchmark>], results: &Results) -> Result<Vec<String>> {
    let mut all = Vec::new();
    for benchmark in benchmarks {
        let Some(measured) = results.benchmarks.get(benchmark.name()) else { continue };
        let faults = benchmark.faults(&from_value::<Measured>(measured)?.parts)?;
        all.extend(faults.into_iter().map(|fault| format!("{}/{fault}", benchmark.name())));
    }
    Ok(all)
}

/// Merges shards. Errors, which name the file: the program, device or settings differ, or two shards have the same
/// part.
pub fn merge(shards: Vec<(&Path, Results)>) -> Result<Results> {
    let mut shards = shards.into_iter();
    let Some((first, mut all)) = shards.next() else {
        return Err(Error::Simulation("there is nothing to merge; name the shards' directories".into()));
    };
    for (file, shard) in shards {
        // Each machine measures which depth path is faster, and may choose either if both are about as fast.
        if (Head { depth_path: all.head.depth_path.clone(), ..shard.head }) != all.head {
            let problem = format!("differs in program, device or options from {}", first.display());
            return Err(Error::input(file, None, problem, "merge shards of one sweep"));
        }
        for (name, measured) in shard.benchmarks {
            let own = all.benchmarks.entry(&name).or_insert(Value::Null);
            *own = if own.is_null() { measured } else { joined(file, &name, own, &measured)? };
        }
    }
    Ok(all)
}

fn joined(file: &Path, name: &str, own: &Value, other: &Value) -> Result<Value> {
    let (own, other): (Measured, Measured) = (from_value(own)?, from_value(other)?);
    if own.settings != other.settings || own.names != other.names {
        let problem = format!("has other settings for `{name}` than the first directory");
        return Err(Error::input(file, None, problem, "merge shards of one sweep"));
    }
    if let Some(part) = other.parts.keys().find(|part| own.parts.contains_key(*part)) {
        let problem = format!("has `{part}` of `{name}`, which another directory has as well");
        return Err(Error::input(file, None, problem, "name each shard once"));
    }
    let both = |one: &Map<String, Value>, two: &Map<String, Value>| {
        let of = |part: &String| Some((part.clone(), one.get(part).or_else(|| two.get(part))?.clone()));
        own.names.iter().filter_map(of).collect()
    };
    let (parts, gauges) = (both(&own.parts, &other.parts), both(&own.gauges, &other.gauges));
    to_value(&Measured { parts, gauges, ..own })
}

/// Reads `results.json`. Errors name the file.
pub fn read(file: &Path) -> Result<Results> {
    let remedy = "name a results.json of `palpate bench`, or its directory";
    let text = files::text(file, remedy)?;
    let value: Value =
        serde_json::from_str(&text).map_err(|e| Error::input(file, Some(e.line()), e.to_string(), remedy))?;
    if value["schema"] != SCHEMA {
        let problem = format!("has schema {}, but this version reads schema {SCHEMA}", value["schema"]);
        return Err(Error::input(file, None, problem, "measure it again with this version"));
    }
    serde_json::from_value(value).map_err(|e| Error::input(file, None, e.to_string(), remedy))
}

/// Converts a value to JSON.
pub fn to_value<T: Serialize>(value: &T) -> Result<Value> {
    serde_json::to_value(value).map_err(|error| Error::Simulation(format!("results cannot be written: {error}")))
}

/// Reads a value from JSON that this program wrote.
pub fn from_value<T: DeserializeOwned>(value: &Value) -> Result<T> {
    T::deserialize(value).map_err(|error| Error::Simulation(format!("results cannot be read: {error}")))
}

/// Reads the measurements of the part `name`; the default (nothing) if the part was not measured.
pub fn part<T: DeserializeOwned + Default>(parts: &Map<String, Value>, name: &str) -> Result<T> {
    parts.get(name).map_or_else(|| Ok(T::default()), from_value)
}

/// Reads a number that may be null, which stands for NaN in JSON.
pub fn nan_of_null<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
#[path = "suite_tests.rs"]
mod tests;
