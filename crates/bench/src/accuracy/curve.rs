//! Error against run time: a curve, its points, and what they say.

use serde::{Deserialize, Serialize};

use crate::samples::hands;
use crate::{fit, median};

/// Changes of a force that a person just notices, of the force: X. D. Pang, H. Z. Tan and N. I. Durlach, "Manual
/// discrimination of force using active finger motion" (1991), found roughly 7 %.
pub const JUST_NOTICEABLE: f64 = 0.07;
/// An order is as theory has it when it is this near.
pub const NEAR_ORDER: f64 = 0.25;
/// Errors should span so many powers of ten.
pub const DECADES: f64 = 2.0;
/// Points of an asymptotic part have errors below this.
const ASYMPTOTIC: f64 = 0.1;
/// The finest settings are on a floor, where something else has the error, while the logarithm of the error falls by
/// less than this with the knob, or with its logarithm where a power is sought.
const FLOOR: f64 = 0.3;
/// A power is fitted to so many points at most, the finest above the floor ...
const MOST_POINTS: usize = 5;
/// ... and at least.
const LEAST_POINTS: usize = 3;
/// A power is told where no two neighbours have one that is further from it.
const SCATTER: f64 = 1.0;
/// An error that is less than both neighbours' by more than this factor is so by chance: it changed its sign there.
const CHANCE: f64 = 2.0;
/// Steps whose times are nearer than this, of the dearer, cost the same ...
const SAME_COST: f64 = 0.05;
/// ... and errors that are nearer, of the greater, are the same.
const SAME_ERROR: f64 = 0.05;

/// What one knob of a scene buys: error and time of each of its settings, measured turn by turn.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Curve {
    /// Name of its part: `tolerance`.
    pub name: String,
    /// Heading.
    pub title: String,
    /// What was asked, of which scene, and what the error is measured against.
    pub question: String,
    /// What the settings are numbers of, with its unit: `time step, ms`.
    pub knob: String,
    /// Which stage the knob is about; its time stands beside the step's.
    pub stage: String,
    /// Setting by setting, in the order of the knob: of each line the finest last.
    pub points: Vec<Point>,
    /// The order of convergence that theory expects of the force, and why; `None`: the knob has none.
    pub expected: Option<Expected>,
    /// Instead of a power: by which law the error falls by a share with each unit of the knob; empty: by none.
    pub share: String,
    /// Why the order may be another than theory's.
    pub order_reason: String,
    /// Why the errors may span less than two decades.
    pub span_reason: String,
    /// The settings that are judged must have a force within this of the reference, of it.
    pub bound: f64,
    /// Which are judged.
    pub judged: Judged,
    /// Title of a plot that is not: what it shows beside is not the engine's.
    pub beside: String,
}

/// Which settings must be within a curve's bound.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Judged {
    /// The finest of each line: another may be near by chance.
    #[default]
    Finest,
    /// The finest of each panel, where its lines are one set of settings.
    FinestOfPanel,
    /// Every one, where none is finer than another.
    Every,
}

/// A line of a curve: points of one panel and name, in the order of the knob.
#[derive(Debug, Clone, PartialEq)]
pub struct Line<'a> {
    /// Title of the plot that it is in.
    pub panel: &'a str,
    /// Its name there.
    pub name: &'a str,
    /// Its points.
    pub points: Vec<&'a Point>,
}

/// What theory says of an error: that it falls as a power of the knob.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Expected {
    /// The power.
    pub order: f64,
    /// By which law.
    pub law: String,
    /// Whether it is told from the displacements, and not from the force.
    pub is_of_shape: bool,
}

/// A setting and what was measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What it is called in a table: `jacobi to 1e-4`.
    pub setting: String,
    /// Which of the curve's lines it is on; empty where there is one.
    pub line: String,
    /// Title of the plot that the line is in, of several; empty where there is one.
    pub panel: String,
    /// The knob's number.
    pub value: f64,
    /// Error of the net force, of the reference's; `None`: nothing is touched, or it is not finite.
    pub force_error: Option<f64>,
    /// Error of the displacements, largest over the largest of the reference's; `None` as above.
    pub displacement_error: Option<f64>,
    /// Solver iterations of a step, median.
    pub iterations: f64,
    /// Names of the flags that were raised.
    pub flags: Vec<String>,
    /// Microseconds of the curve's stage, a step each, for each round.
    pub stage_us: Vec<Vec<f64>>,
    /// Microseconds of a step, pose in and wrench out, for each round.
    pub step_us: Vec<Vec<f64>>,
    /// Keys of a scene and what the setting has there, where a preset may come of it.
    pub keys: Vec<(String, String)>,
    /// Seconds of the simulated world that a step is, where points differ in it; else 0.
    pub simulated_s: f64,
}

impl Point {
    /// Milliseconds of a step: the median over the steps of a round, the median of those.
    pub fn step_ms(&self) -> f64 {
        ms(&self.step_us)
    }

    /// The same of the stage.
    pub fn stage_ms(&self) -> f64 {
        ms(&self.stage_us)
    }

    /// From the fastest to the slowest round, or hand of few rounds (see [`hands`]), milliseconds a step.
    pub fn step_range_ms(&self) -> [f64; 2] {
        let rounds: Vec<f64> = hands(&self.step_us).iter().map(|us| 1e-3 * us).collect();
        [rounds.iter().copied().fold(f64::INFINITY, f64::min), rounds.iter().copied().fold(0.0, f64::max)]
    }

    /// The same in units of [`Point::cost`].
    pub fn cost_range(&self) -> [f64; 2] {
        let unit = if self.simulated_s > 0.0 { 1e-3 / self.simulated_s } else { 1.0 };
        self.step_range_ms().map(|ms| unit * ms)
    }

    /// Whether it costs less than another beyond noise: each of its rounds, or hands, than each of the other's, and its median
    /// by 5 %.
    pub fn is_cheaper(&self, other: &Point) -> bool {
        self.cost() < (1.0 - SAME_COST) * other.cost() && self.cost_range()[1] < other.cost_range()[0]
    }

    /// What is paid: milliseconds of a step, or where steps differ in length their time over the time that they simulate.
    pub fn cost(&self) -> f64 {
        if self.simulated_s > 0.0 { 1e-3 * self.step_ms() / self.simulated_s } else { self.step_ms() }
    }

    /// The error that counts: of the force, or of the displacements where nothing is touched.
    pub fn error(&self) -> Option<f64> {
        self.force_error.or(self.displacement_error)
    }

    /// Whether no other is at once cheaper and no less accurate, or more accurate and no dearer, each by 5 % at least; flagged
    /// ones do not count.
    fn is_best_of(&self, others: &[Point]) -> bool {
        let Some(error) = self.error().filter(|_| self.flags.is_empty()) else { return false };
        let is_better = |other: &Point| match other.error().filter(|_| other.flags.is_empty()) {
            Some(its) => {
                let (is_as_accurate, is_better) = ((1.0 - SAME_ERROR) * its <= error, its < (1.0 - SAME_ERROR) * error);
                is_as_accurate && other.is_cheaper(self) || is_better && !self.is_cheaper(other)
            }
            None => false,
        };
        !others.iter().any(is_better)
    }
}

impl Curve {
    /// Its lines, in order of their first points.
    pub fn lines(&self) -> Vec<Line<'_>> {
        let mut lines: Vec<Line> = Vec::new();
        for point in &self.points {
            match lines.iter_mut().find(|line| line.panel == point.panel && line.name == point.line) {
                Some(line) => line.points.push(point),
                None => lines.push(Line { panel: &point.panel, name: &point.line, points: vec![point] }),
            }
        }
        lines
    }

    /// Which points are the best buys among those of their panel: no other is faster beyond noise and as accurate. None is of
    /// what is not the engine's.
    pub fn best(&self) -> Vec<bool> {
        let panel = |name: &str| self.points.iter().filter(|other| other.panel == name).cloned().collect::<Vec<_>>();
        let is_own = |point: &Point| self.beside.is_empty() || point.panel != self.beside;
        self.points.iter().map(|point| is_own(point) && point.is_best_of(&panel(&point.panel))).collect()
    }

    /// Powers of ten that the errors of a line span, of the line where they are most.
    pub fn decades(&self) -> f64 {
        self.lines().iter().map(Line::decades).fold(0.0, f64::max)
    }

    /// The error that counts for each line, or for all as one; `None`: it is no number.
    pub fn counted(&self) -> Vec<(Line<'_>, Option<f64>)> {
        let lines = || self.lines().into_iter().filter(|line| self.beside.is_empty() || line.panel != self.beside);
        match self.judged {
            Judged::Finest => lines().map(|line| (line.clone(), line.finest())).collect(),
            Judged::Every => lines().map(|line| (line.clone(), line.worst())).collect(),
            Judged::FinestOfPanel => {
                let panels = self.points.chunk_by(|a, b| a.panel == b.panel);
                let whole = panels.map(|own| Line { panel: &own[0].panel, name: "", points: own.iter().collect() });
                whole.map(|line| (line.clone(), line.finest())).collect()
            }
        }
    }

    /// Those whose error that counts is beyond the bound, or no number.
    pub fn beyond(&self) -> Vec<(Line<'_>, Option<f64>)> {
        let all = self.counted().into_iter();
        all.filter(|(_, error)| error.is_none_or(|error| error > self.bound || error.is_nan())).collect()
    }

    /// Whether every line is within the bound.
    pub fn is_within(&self) -> bool {
        !self.counted().is_empty() && self.beyond().is_empty()
    }
}

impl Line<'_> {
    /// Its panel and its name, as far as it has them.
    pub fn title(&self) -> String {
        let parts = [self.panel, self.name];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }

    /// The error of the finest setting.
    pub fn finest(&self) -> Option<f64> {
        self.points.last()?.error()
    }

    /// The greatest error; `None` where one is no number.
    pub fn worst(&self) -> Option<f64> {
        let errors: Option<Vec<f64>> = self.points.iter().map(|point| point.error()).collect();
        errors?.into_iter().max_by(f64::total_cmp)
    }

    /// Powers of ten between the least and the greatest error above zero, without those that are small by chance.
    pub fn decades(&self) -> f64 {
        let all: Vec<f64> = self.points.iter().filter_map(|point| point.error()).filter(|error| *error > 0.0).collect();
        let is_chance = |k: usize| k > 0 && k + 1 < all.len() && CHANCE * all[k] < all[k - 1].min(all[k + 1]);
        let errors = all.iter().enumerate().filter(|(k, _)| !is_chance(*k)).map(|(_, error)| *error);
        let (low, high) = errors.fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
        if low < high { (high / low).log10() } else { 0.0 }
    }

    /// The power of the knob by which the error falls, of the displacements or of the force, and of how many points: least
    /// squares of the logarithms over the asymptotic part; `None` where that has fewer than three, or where neighbours have
    /// powers of their own that are far from it.
    pub fn order(&self, is_of_shape: bool) -> Option<(f64, usize)> {
        let fitted = self.asymptotic(&|point| error_of(point, is_of_shape), f64::ln);
        let order = fit::exponent(&fitted)?;
        let is_one = fitted.windows(2).all(|pair| (local_order(pair) - order).abs() <= SCATTER);
        is_one.then_some((order, fitted.len()))
    }

    /// The power between each setting and the next whose errors are above zero.
    pub fn local_orders(&self, is_of_shape: bool) -> Vec<f64> {
        let all = self.points.iter().filter_map(|point| Some((point.value, error_of(point, is_of_shape)?)));
        all.filter(|(_, error)| *error > 0.0).collect::<Vec<_>>().windows(2).map(local_order).collect()
    }

    /// What a unit of the knob leaves of the error, and of how many points: the same with the knob itself.
    pub fn share(&self) -> Option<(f64, usize)> {
        let fitted = self.asymptotic(&Point::error, |x| x);
        let fitted: Vec<(f64, f64)> = fitted.iter().map(|(x, y)| (x.exp(), *y)).collect();
        Some((fit::exponent(&fitted)?.exp(), fitted.len()))
    }

    /// Knob and error of the finest settings whose errors are small, without those that are no better than a coarser one.
    /// `scale`: of the knob, along which the error falls evenly.
    fn asymptotic(&self, error: &dyn Fn(&Point) -> Option<f64>, scale: fn(f64) -> f64) -> Vec<(f64, f64)> {
        let all = self.points.iter().filter_map(|point| Some((point.value, error(point)?)));
        let mut all: Vec<(f64, f64)> = all.filter(|(_, error)| *error > 0.0).collect();
        let is_first_coarse = all.first().zip(all.last()).is_some_and(|(a, b)| a.1 > b.1);
        if is_first_coarse {
            all.reverse();
        }
        let falls =
            |pair: &[(f64, f64)]| (pair[1].1 / pair[0].1).ln() > FLOOR * (scale(pair[1].0) - scale(pair[0].0)).abs();
        let floor = all.windows(2).position(falls).unwrap_or(all.len());
        let fitted: Vec<_> = all[floor..].iter().copied().filter(|(_, e)| *e < ASYMPTOTIC).take(MOST_POINTS).collect();
        if fitted.len() < LEAST_POINTS { Vec::new() } else { fitted }
    }
}

/// The power between the last two of some points; `None` where there are not two with errors above zero.
pub fn last_order(points: &[Point]) -> Option<f64> {
    let line = Line { panel: "", name: "", points: points.iter().collect() };
    line.local_orders(false).last().copied()
}

fn error_of(point: &Point, is_of_shape: bool) -> Option<f64> {
    if is_of_shape { point.displacement_error } else { point.error() }
}

fn local_order(pair: &[(f64, f64)]) -> f64 {
    (pair[0].1 / pair[1].1).ln() / (pair[0].0 / pair[1].0).ln()
}

fn ms(rounds: &[Vec<f64>]) -> f64 {
    1e-3 * median(&rounds.iter().map(|round| median(round)).collect::<Vec<_>>())
}

#[cfg(test)]
#[path = "curve_tests.rs"]
mod tests;
