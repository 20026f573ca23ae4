//! Finds the measurements in `results.json` (the results of `palpate bench`) that are compared with those of other
//! results, and the path of each in that file.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::samples::hands;
use crate::suite::Results;

/// One measurement.
pub enum Series {
    /// Time, us: medians of the rounds (repeated runs), or of interleaved subsets of their samples.
    Times(Vec<f64>),
    /// Relative error; NaN where it was written as null.
    Error(f64),
    /// Solver iterations; the mean, if there is a list of them.
    Iterations(f64),
    /// Number of passes (kernels, fills and copies on the GPU), or of bytes.
    Size(f64),
    /// Names of flags (warnings of a step).
    Flags(Vec<String>),
}

/// All measurements of the results, by path.
pub fn series_of(results: &Results) -> BTreeMap<String, Series> {
    let mut all = BTreeMap::new();
    for (name, measured) in &results.benchmarks {
        if let Some(parts) = measured.get("parts") {
            collect(&mut all, name, parts, false);
        }
    }
    all
}

/// Collects the measurements below `path`. Keys that end in `_us` hold times, as one round or a list of rounds;
/// `is_timed`: `path` contains such a key. Keys that end in `error` hold an error; iterations, sizes and flags have
/// keys of fixed names.
fn collect(all: &mut BTreeMap<String, Series>, path: &str, value: &Value, is_timed: bool) {
    let key = path.rsplit('/').next().unwrap_or_default();
    let number = || value.as_f64().or_else(|| mean(&numbers(value)?));
    let series = match (key, value) {
        (_, Value::Array(_)) if is_timed => rounds(value).map(Series::Times),
        ("iterations", _) => number().map(Series::Iterations),
        ("bytes_device" | "passes" | "dependent_passes", _) => value.as_f64().map(Series::Size),
        ("flags", Value::Array(names)) => {
            Some(Series::Flags(names.iter().filter_map(|name| Some(name.as_str()?.into())).collect()))
        }
        // JSON has no NaN or infinity; they are written as null.
        (key, Value::Number(_) | Value::Null) if key.ends_with("error") => {
            Some(Series::Error(value.as_f64().unwrap_or(f64::NAN)))
        }
        _ => None,
    };
    if let Some(series) = series {
        all.insert(path.into(), series);
        return;
    }
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                collect(all, &format!("{path}/{key}"), value, is_timed || key.ends_with("_us"));
            }
        }
        Value::Array(items) if !is_timed => {
            for (k, item) in items.iter().enumerate() {
                collect(all, &format!("{path}/{}", called(item).unwrap_or(k.to_string())), item, false);
            }
        }
        _ => (),
    }
}

/// Words that distinguish an item of a list from the others: the values of its keys `name`, `line`, `preconditioner`,
/// `setting` and `tolerance`; `None` if it has none of these keys.
fn called(item: &Value) -> Option<String> {
    let parts = ["name", "line", "preconditioner", "setting", "tolerance"].into_iter().filter_map(|key| item.get(key));
    let words: Vec<String> = parts.map(|v| v.as_str().map_or_else(|| v.to_string(), Into::into)).collect();
    if words.is_empty() { None } else { Some(words.join(" ").trim().into()) }
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}

fn mean(all: &[f64]) -> Option<f64> {
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Medians of the rounds or, with fewer than five rounds, of interleaved subsets of their samples (see [`hands`]);
/// `None`: there are no samples.
fn rounds(value: &Value) -> Option<Vec<f64>> {
    let each: Vec<Vec<f64>> = match numbers(value) {
        Some(one) => vec![one],
        None => value.as_array()?.iter().map(numbers).collect::<Option<_>>()?,
    };
    Some(hands(&each)).filter(|hands| !hands.is_empty())
}
