//! Two results side by side: how many times as long each thing takes now, and whether that is more than noise.

use std::collections::BTreeMap;

use serde_json::Value;

use super::suite::Results;
use super::samples::{HANDS, hands};
use super::{Table, median};
use crate::{Error, Result};

/// Slower by less than this beyond the spread of both is no regression: so much the same program differs on a busy machine.
const ALLOWED: f64 = 0.10;
/// Errors are the same bits on the same device; of another, they may be so much greater.
const ALLOWED_ERROR: f64 = 0.10;
/// Errors below this are rounding.
const ROUNDING: f64 = 1e-6;
/// Ranges of fewer rounds, or hands, do not overlap too often by chance: of five and five once in 252 comparisons.
const LEAST_ROUNDS: usize = HANDS;

/// What is compared, now and before.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Where it stands in `results.json`: `solver/block10k-20kPa-1ms/runs/jacobi 1e-5/step_us`.
    pub path: String,
    /// Whether it is a time; else an error.
    pub is_time: bool,
    /// Median of the old one's rounds: us, or the error.
    pub old: f64,
    /// Median of the new one's.
    pub new: f64,
    /// New over old: the fastest round over the slowest, the medians, the slowest over the fastest.
    pub ratio: [f64; 3],
    /// Whether even the first of these is above 1 by more than is allowed, or there are too few rounds to say.
    pub verdict: Verdict,
}

/// What a ratio says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Slower, or a greater error, beyond noise.
    Worse,
    /// Faster, or a smaller error, beyond noise.
    Better,
    /// Within noise.
    Same,
    /// Too few samples.
    Unjudged,
}

/// All times and errors that both have, and what only one has. Errors: they were measured with other settings.
pub fn compare(old: &Results, new: &Results) -> Result<(Vec<Comparison>, Vec<String>)> {
    for (name, measured) in &old.benchmarks {
        let differs = new.benchmarks.get(name).is_some_and(|other| other["settings"] != measured["settings"]);
        if differs || old.head.is_quick != new.head.is_quick {
            let problem = format!("`{name}` was measured with other settings than what it is to be compared with");
            return Err(Error::Usage(format!("{problem}; measure both alike, with or without --quick")));
        }
    }
    let (before, mut now) = (series_of(old), series_of(new));
    let (mut all, mut lonely) = (Vec::new(), Vec::new());
    for (path, old) in before {
        match now.remove(&path) {
            Some(new) => all.extend(Comparison::new(path, &old, &new)),
            None => lonely.push(path),
        }
    }
    lonely.extend(now.into_keys());
    Ok((all, lonely))
}

impl Comparison {
    fn new(path: String, old: &Series, new: &Series) -> Option<Comparison> {
        let (old, new, is_time) = match (old, new) {
            (Series::Times(old), Series::Times(new)) => (old, new, true),
            (Series::Error(old), Series::Error(new)) => (old, new, false),
            _ => return None,
        };
        let low = |all: &[f64]| all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let ratio = [low(new) / high(old), median(new) / median(old), high(new) / low(old)];
        let allowed = 1.0 + if is_time { ALLOWED } else { ALLOWED_ERROR };
        let is_judged = !is_time || (old.len().min(new.len()) >= LEAST_ROUNDS && low(old) > 0.0);
        let is_rounding = !is_time && median(new).max(median(old)) < ROUNDING;
        let verdict = match ratio {
            _ if !is_judged => Verdict::Unjudged,
            // An error that is no number any more is the worst of all.
            _ if !is_time && new[0].is_nan() => {
                if old[0].is_nan() {
                    Verdict::Same
                } else {
                    Verdict::Worse
                }
            }
            _ if !is_time && old[0].is_nan() => Verdict::Better,
            _ if is_rounding => Verdict::Same,
            [low, ..] if low > allowed => Verdict::Worse,
            [.., high] if high * allowed < 1.0 => Verdict::Better,
            _ => Verdict::Same,
        };
        Some(Comparison { path, is_time, old: median(old), new: median(new), ratio, verdict })
    }
}

/// A row each; those that are worse first, then better ones, then by name.
pub fn table(all: &[Comparison]) -> Table {
    let mut sorted: Vec<&Comparison> = all.iter().collect();
    let rank = |verdict| match verdict {
        Verdict::Worse => 0,
        Verdict::Better => 1,
        Verdict::Same => 2,
        Verdict::Unjudged => 3,
    };
    sorted.sort_by_key(|c| rank(c.verdict));
    let mut table = Table::new(["what", "old", "new", "ratio", "from", "to", "verdict"]);
    for Comparison { path, is_time, old, new, ratio, verdict } in sorted {
        let number = |x: f64| if *is_time { format!("{x:.1} us") } else { format!("{x:.2e}") };
        let verdict = match (verdict, is_time) {
            (Verdict::Worse, true) => "slower",
            (Verdict::Worse, false) => "greater error",
            (Verdict::Better, true) => "faster",
            (Verdict::Better, false) => "smaller error",
            (Verdict::Same, _) => "same",
            (Verdict::Unjudged, _) => "too few samples",
        };
        let mut row = vec![path.clone(), number(*old), number(*new)];
        row.extend([ratio[1], ratio[0], ratio[2]].map(|x| format!("{x:.2}")));
        row.push(verdict.into());
        table.rows.push(row);
    }
    table
}

enum Series {
    /// Medians of the rounds, us.
    Times(Vec<f64>),
    /// The one number.
    Error(Vec<f64>),
}

fn series_of(results: &Results) -> BTreeMap<String, Series> {
    let mut all = BTreeMap::new();
    for (name, measured) in &results.benchmarks {
        if let Some(parts) = measured.get("parts") {
            collect(&mut all, name, parts, false);
        }
    }
    all
}

/// Keys that end in `_us` hold samples, in one round or a list of rounds; keys that end in `error` an error.
fn collect(all: &mut BTreeMap<String, Series>, path: &str, value: &Value, is_timed: bool) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                collect(all, &format!("{path}/{key}"), value, is_timed || key.ends_with("_us"));
            }
        }
        Value::Array(_) if is_timed => {
            if let Some(rounds) = rounds(value) {
                all.insert(path.into(), Series::Times(rounds));
            }
        }
        Value::Array(items) => {
            for (k, item) in items.iter().enumerate() {
                collect(all, &format!("{path}/{}", called(item).unwrap_or(k.to_string())), item, false);
            }
        }
        // What is not a number is written as null.
        Value::Number(_) | Value::Null if path.ends_with("error") => {
            all.insert(path.into(), Series::Error(vec![value.as_f64().unwrap_or(f64::NAN)]));
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

/// Medians of rounds, or of hands where there are too few rounds; `None`: there is nothing to tell.
fn rounds(value: &Value) -> Option<Vec<f64>> {
    let each: Vec<Vec<f64>> = match numbers(value) {
        Some(one) => vec![one],
        None => value.as_array()?.iter().map(numbers).collect::<Option<_>>()?,
    };
    Some(hands(&each)).filter(|hands| !hands.is_empty())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::bench::suite::Head;

    fn results(parts: Value) -> Results {
        let head = Head {
            schema: 3,
            version: "0".into(),
            commit: "c".into(),
            device: "d".into(),
            driver: "e".into(),
            depth_path: "compute".into(),
            threads: 2,
            is_quick: true,
        };
        let benchmarks = [("solver".to_string(), json!({ "settings": {}, "names": [], "parts": parts }))];
        Results { head, benchmarks: benchmarks.into_iter().collect() }
    }

    fn timed(rounds: [f64; 3]) -> Results {
        let [low, middle, high] = rounds;
        let rounds = [low, middle, middle, middle, high].map(|us| vec![us; 4]);
        results(json!({ "p": { "runs": [{ "setting": "s", "step_us": rounds, "force_error": 0.01 }] } }))
    }

    fn only(old: &Results, new: &Results, end: &str) -> Comparison {
        let (all, lonely) = compare(old, new).unwrap();
        assert!(lonely.is_empty());
        all.into_iter().find(|c| c.path.ends_with(end)).unwrap()
    }

    #[test]
    fn slower_is_worse_only_beyond_the_spread() {
        let old = timed([10.0, 11.0, 12.0]);
        let noisy = only(&old, &timed([11.5, 14.0, 18.0]), "step_us");
        assert_eq!((noisy.verdict, noisy.ratio[1]), (Verdict::Same, 14.0 / 11.0));
        assert_eq!(noisy.path, "solver/p/runs/s/step_us");
        assert_eq!(only(&old, &timed([13.3, 14.0, 18.0]), "step_us").verdict, Verdict::Worse);
        assert_eq!(only(&timed([13.3, 14.0, 18.0]), &old, "step_us").verdict, Verdict::Better);
    }

    #[test]
    fn greater_errors_are_worse_and_rounding_is_none() {
        let of = |error: f64| results(json!({ "p": { "force_error": error } }));
        assert_eq!(only(&of(0.01), &of(0.012), "error").verdict, Verdict::Worse);
        assert_eq!(only(&of(0.01), &of(0.0105), "error").verdict, Verdict::Same);
        assert_eq!(only(&of(1e-8), &of(5e-7), "error").verdict, Verdict::Same);
        assert_eq!(only(&of(0.02), &of(0.01), "error").verdict, Verdict::Better);
        assert_eq!(only(&of(0.02), &of(f64::NAN), "error").verdict, Verdict::Worse);
        assert_ne!(only(&of(f64::NAN), &of(f64::NAN), "error").verdict, Verdict::Worse);
    }

    #[test]
    fn other_settings_are_not_compared() {
        let mut other = results(json!({}));
        other.benchmarks["solver"]["settings"] = json!({ "steps": 7 });
        assert!(compare(&results(json!({})), &other).unwrap_err().to_string().contains("`solver` was measured"));
        let mut other = results(json!({}));
        other.head.is_quick = false;
        assert!(compare(&results(json!({})), &other).is_err());
    }

    #[test]
    fn one_round_is_dealt_out_and_few_samples_are_not_judged() {
        let of = |us: Vec<f64>| results(json!({ "p": { "samples_us": { "pose": us } } }));
        let old = of((0..50).map(|k| 10.0 + f64::from(k % 3)).collect());
        assert_eq!(only(&old, &of(vec![20.0; 50]), "pose").verdict, Verdict::Worse);
        assert_eq!(only(&of(vec![1.0]), &of(vec![9.0]), "pose").verdict, Verdict::Unjudged);
        assert_eq!(only(&of(vec![0.0; 50]), &of(vec![9.0; 50]), "pose").verdict, Verdict::Unjudged);
        let (all, lonely) = compare(&old, &results(json!({}))).unwrap();
        assert!(all.is_empty() && lonely == ["solver/p/samples_us/pose"]);
    }

    #[test]
    fn the_table_begins_with_what_is_worse() {
        let (old, new) = (timed([10.0, 11.0, 12.0]), timed([20.0, 21.0, 22.0]));
        let rows = table(&compare(&old, &new).unwrap().0).rows;
        assert!(rows[0][0].ends_with("step_us") && rows[0][6] == "slower" && rows[1][6] == "same", "{rows:?}");
        assert_eq!(rows[0][3..6], ["1.91", "1.67", "2.20"]);
    }
}
