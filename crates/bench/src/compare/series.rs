//! What of `results.json` is compared, by where it stands there.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::samples::hands;
use crate::suite::Results;

/// Something that is measured.
pub enum Series {
    /// Medians of the rounds, us.
    Times(Vec<f64>),
    /// NaN: it is no number.
    Error(f64),
    /// Their mean, where there are many.
    Iterations(f64),
    /// Passes or bytes.
    Size(f64),
    /// Names.
    Flags(Vec<String>),
}

/// All series of results.
pub fn series_of(results: &Results) -> BTreeMap<String, Series> {
    let mut all = BTreeMap::new();
    for (name, measured) in &results.benchmarks {
        if let Some(parts) = measured.get("parts") {
            collect(&mut all, name, parts, false);
        }
    }
    all
}

/// Keys that end in `_us` hold samples, in one round or a list of rounds; keys that end in `error` an error; others of which
/// more is worse are known by their names.
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
        // What is not a number is written as null.
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

/// What tells an item of a list from the others, if it says so.
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

/// Medians of rounds, or of hands where there are too few rounds; `None`: there is nothing to tell.
fn rounds(value: &Value) -> Option<Vec<f64>> {
    let each: Vec<Vec<f64>> = match numbers(value) {
        Some(one) => vec![one],
        None => value.as_array()?.iter().map(numbers).collect::<Option<_>>()?,
    };
    Some(hands(&each)).filter(|hands| !hands.is_empty())
}
