//! Compares two results of `palpate bench`, an old and a new one. For each time it finds the ratio of new to old, and
//! whether this ratio is beyond noise. For quantities without noise it finds whether they grew: errors of forces and
//! displacements, solver iterations, passes (kernels, fills and copies on the GPU), memory, and flags (warnings of a
//! step).
//!
//! A time is measured in rounds, that is, repeated runs. Where there are fewer than five rounds, their samples are
//! dealt into "hands", interleaved subsets (see [`crate::samples::hands`]).

mod series;

use std::collections::BTreeMap;

use palpate::{Error, Result};

use super::samples::HANDS;
use super::suite::Results;
use super::{Table, median};
use series::{Series, series_of};

/// A time may grow by this share beyond the spread of both results: on a busy machine the times of one and the same
/// program differ by as much.
const ALLOWED: f64 = 0.10;
/// An error may grow by this share: on one GPU device it is the same in every run, bit for bit, but devices differ.
const ALLOWED_ERROR: f64 = 0.10;
/// Errors below this are rounding.
const ROUNDING: f64 = 1e-6;
/// Memory and the number of passes may grow by this share, since memory alignment differs between devices.
const ALLOWED_SIZE: f64 = 0.02;
/// Iterations may grow by this share: a difference in the last bit can cost one more iteration.
const ALLOWED_ITERATIONS: f64 = 0.25;
/// A time is judged only with at least this number of rounds (or hands) in each result. With five in each, all new
/// times exceed all old ones by chance in one of 252 comparisons; with fewer, in more comparisons than is acceptable.
const LEAST_ROUNDS: usize = HANDS;
/// From this number of compared times on, a time counts as slower or faster only if its ratio of new to old is an
/// outlier among the ratios of all times (see [`DEVIATIONS`]).
const CROWD: usize = 8;
/// A ratio is an outlier if its logarithm is farther from the median of all logarithms than this number of standard
/// deviations. The standard deviation is estimated from the median absolute deviation.
const DEVIATIONS: f64 = 4.0;
/// A part of a benchmark is slower as a whole if the median ratio of its times exceeds 1 by more than this and enough
/// of its times are slower (see [`MOST`]).
const ALLOWED_PART: f64 = 0.15;
/// Least share of a part's times that must be slower by [`ALLOWED`] for the part to be slower.
const MOST: f64 = 0.75;

/// One measurement in the old and the new result.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Path of the measurement in `results.json`, for example `solver/block10k-20kPa-1ms/runs/jacobi 1e-5/step_us`; for
    /// a part as a whole, the part's name.
    pub path: String,
    /// Kind of quantity.
    pub kind: Kind,
    /// Old value: for a time, the median of its rounds, us; for a part, the sum of its times, us.
    pub old: f64,
    /// New value, in the same unit.
    pub new: f64,
    /// New value divided by the old one. A time has three ratios, all corrected for the machine's own slowdown: that of
    /// the fastest new round to the slowest old one, that of the medians, and that of the slowest new round to the
    /// fastest old one.
    pub ratio: [f64; 3],
    /// The verdict on the ratio. A time is worse only if even the least of its three ratios exceeds 1 by more than is
    /// allowed.
    pub verdict: Verdict,
}

/// Kind of quantity that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Time, us, judged by the medians of its rounds.
    Time,
    /// All times of a part of a benchmark together, judged by the median of their ratios.
    Part,
    /// Relative error of a force or of displacements.
    Error,
    /// Iterations of the solver.
    Iterations,
    /// Number of passes or of bytes.
    Size,
    /// Number of different flags that any step raised.
    Flags,
}

/// Verdict on a ratio.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Slower, more, or a greater error, beyond noise.
    Worse,
    /// Faster, less, or a smaller error, beyond noise.
    Better,
    /// Within noise.
    Same,
    /// Too few samples.
    Unjudged,
}

/// Compares all measurements that both results have, and returns the comparisons and the paths of the measurements that
/// only one result has. Errors: the two results were measured with different settings.
pub fn compare(old: &Results, new: &Results) -> Result<(Vec<Comparison>, Vec<String>)> {
    for (name, measured) in &old.benchmarks {
        let differs = new.benchmarks.get(name).is_some_and(|other| other["settings"] != measured["settings"]);
        if differs || old.head.is_quick != new.head.is_quick {
            let problem = format!("`{name}` has different settings in the two results");
            return Err(Error::Usage(format!("{problem}; measure both alike, with or without --quick")));
        }
    }
    let (before, mut now) = (series_of(old), series_of(new));
    let (mut all, mut lonely) = (Vec::new(), Vec::new());
    for (path, old_series) in before {
        match now.remove(&path) {
            Some(series) => all.extend(Comparison::new(&path, &old_series, &series, machine(old, new, part_of(&path)))),
            None => lonely.push(path),
        }
    }
    lonely.extend(now.into_keys());
    excuse_the_ordinary(&mut all);
    all.extend(parts(&all));
    Ok((all, lonely))
}

/// The first two components of a path: benchmark and part.
fn part_of(path: &str) -> &str {
    let end = path.match_indices('/').nth(1).map_or(path.len(), |(at, _)| at);
    &path[..end]
}

/// Change of the time that the machine took for a fixed piece of work (see `gauge.rs`) while a part was measured: the
/// least, the median and the greatest ratio of new to old; 1 if either result lacks this time.
fn machine(old: &Results, new: &Results, part: &str) -> [f64; 3] {
    match (old.gauge(part), new.gauge(part)) {
        (Some(old), Some(new)) => [low(&new) / high(&old), median(&new) / median(&old), high(&new) / low(&old)],
        _ => [1.0; 3],
    }
}

fn low(all: &[f64]) -> f64 {
    all.iter().copied().fold(f64::INFINITY, f64::min)
}

fn high(all: &[f64]) -> f64 {
    all.iter().copied().fold(0.0, f64::max)
}

impl Comparison {
    /// `None`: the two series are of different kinds. `machine`: by what factors the machine itself took longer, as the
    /// function [`machine`] returns them; ratios of times are divided by these factors.
    fn new(path: &str, old: &Series, new: &Series, machine: [f64; 3]) -> Option<Comparison> {
        let (kind, old, new, ratio, verdict) = match (old, new) {
            (Series::Times(old), Series::Times(new)) => {
                let ratio = [
                    low(new) / high(old) / machine[2],
                    median(new) / median(old) / machine[1],
                    high(new) / low(old) / machine[0],
                ];
                let is_judged = old.len().min(new.len()) >= LEAST_ROUNDS && low(old) > 0.0;
                let verdict = if is_judged { beyond(ratio, ALLOWED) } else { Verdict::Unjudged };
                (Kind::Time, median(old), median(new), ratio, verdict)
            }
            (Series::Error(old), Series::Error(new)) => {
                let verdict = match (old.is_nan(), new.is_nan()) {
                    (true, true) => Verdict::Same,
                    // NaN, where a number was before, is worse than any number.
                    (false, true) => Verdict::Worse,
                    (true, false) => Verdict::Better,
                    _ if old.max(*new) < ROUNDING => Verdict::Same,
                    _ => beyond([new / old; 3], ALLOWED_ERROR),
                };
                (Kind::Error, *old, *new, [new / old; 3], verdict)
            }
            (Series::Iterations(old), Series::Iterations(new)) => {
                (Kind::Iterations, *old, *new, [new / old; 3], beyond([new / old; 3], ALLOWED_ITERATIONS))
            }
            (Series::Size(old), Series::Size(new)) => {
                (Kind::Size, *old, *new, [new / old; 3], beyond([new / old; 3], ALLOWED_SIZE))
            }
            (Series::Flags(old), Series::Flags(new)) => {
                let has_more = |a: &[String], b: &[String]| a.iter().any(|flag| !b.contains(flag));
                let verdict = match (has_more(new, old), has_more(old, new)) {
                    (true, _) => Verdict::Worse,
                    (false, true) => Verdict::Better,
                    (false, false) => Verdict::Same,
                };
                let [old, new] = [old.len() as f64, new.len() as f64];
                (Kind::Flags, old, new, [new / old; 3], verdict)
            }
            _ => return None,
        };
        Some(Comparison { path: path.into(), kind, old, new, ratio, verdict })
    }
}

/// Worse or better where the whole range of a ratio differs from 1 by more than is allowed; else the same.
fn beyond([from, _, to]: [f64; 3], allowed: f64) -> Verdict {
    if from > 1.0 + allowed {
        Verdict::Worse
    } else if to * (1.0 + allowed) < 1.0 {
        Verdict::Better
    } else {
        Verdict::Same
    }
}

/// Sets the verdict of a time to `Same` if its ratio is no outlier among all ratios. The spread within a run is not all
/// of the noise: one run as a whole is slower or faster than another, and in some parts of the benchmark more than in
/// others. If there are many times, the scatter of their ratios shows how large this noise is.
fn excuse_the_ordinary(all: &mut [Comparison]) {
    let judged = |c: &&Comparison| c.kind == Kind::Time && c.verdict != Verdict::Unjudged && c.ratio[1] > 0.0;
    let logs: Vec<f64> = all.iter().filter(judged).map(|c| c.ratio[1].ln()).collect();
    if logs.len() < CROWD {
        return;
    }
    let middle = median(&logs);
    // The standard deviation of a normal distribution is 1.4826 times its median absolute deviation.
    let deviation = 1.4826 * median(&logs.iter().map(|x| (x - middle).abs()).collect::<Vec<_>>());
    for c in all.iter_mut().filter(|c| c.kind == Kind::Time) {
        let distance = c.ratio[1].ln() - middle;
        let is_ordinary = distance.abs() <= DEVIATIONS * deviation;
        if is_ordinary && matches!(c.verdict, Verdict::Worse | Verdict::Better) {
            c.verdict = Verdict::Same;
        }
    }
}

/// A comparison of each part as a whole, for parts with at least [`LEAST_ROUNDS`] judged times.
fn parts(all: &[Comparison]) -> Vec<Comparison> {
    let mut by_part: BTreeMap<&str, Vec<&Comparison>> = BTreeMap::new();
    for c in all.iter().filter(|c| c.kind == Kind::Time && c.verdict != Verdict::Unjudged) {
        by_part.entry(part_of(&c.path)).or_default().push(c);
    }
    let of = |(part, own): (&str, Vec<&Comparison>)| {
        let ratios: Vec<f64> = own.iter().map(|c| c.ratio[1]).collect();
        let share = |is: &dyn Fn(f64) -> bool| ratios.iter().filter(|x| is(**x)).count() as f64 / ratios.len() as f64;
        let middle = median(&ratios);
        let verdict = match beyond([middle; 3], ALLOWED_PART) {
            Verdict::Worse if share(&|x| x > 1.0 + ALLOWED) < MOST => Verdict::Same,
            Verdict::Better if share(&|x| x * (1.0 + ALLOWED) < 1.0) < MOST => Verdict::Same,
            verdict => verdict,
        };
        let sum = |of: &dyn Fn(&Comparison) -> f64| own.iter().map(|c| of(c)).sum::<f64>();
        Comparison {
            path: part.into(),
            kind: Kind::Part,
            old: sum(&|c| c.old),
            new: sum(&|c| c.new),
            ratio: [low(&ratios), middle, high(&ratios)],
            verdict,
        }
    };
    by_part.into_iter().filter(|(_, own)| own.len() >= LEAST_ROUNDS).map(of).collect()
}

/// A table with a row for each comparison: worse ones first, then better, unchanged and unjudged ones.
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
    for Comparison { path, kind, old, new, ratio, verdict } in sorted {
        let number = |x: f64| match kind {
            Kind::Time | Kind::Part => format!("{x:.1} us"),
            Kind::Error => format!("{x:.2e}"),
            Kind::Iterations => format!("{x:.1}"),
            Kind::Size | Kind::Flags => format!("{x}"),
        };
        let words = match kind {
            Kind::Time | Kind::Part => ["slower", "faster"],
            Kind::Error => ["greater error", "smaller error"],
            Kind::Iterations | Kind::Size => ["more", "less"],
            Kind::Flags => ["new flags", "fewer flags"],
        };
        let verdict = match verdict {
            Verdict::Worse => words[0],
            Verdict::Better => words[1],
            Verdict::Same => "same",
            Verdict::Unjudged => "too few samples",
        };
        let path = if *kind == Kind::Part { format!("{path}, all times together") } else { path.clone() };
        let mut row = vec![path, number(*old), number(*new)];
        row.extend([ratio[1], ratio[0], ratio[2]].map(|x| format!("{x:.2}")));
        row.push(verdict.into());
        table.rows.push(row);
    }
    table
}

#[cfg(test)]
mod tests;
