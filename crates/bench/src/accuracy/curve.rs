//! A curve of `palpate bench accuracy`: the error and the computing time of a step for each setting of one knob. A knob
//! is a value of a scene that is varied, and a setting is one of its values. From the settings follow the best buys
//! (settings that no other beats in both error and time), the orders of convergence, and the verdict whether the errors
//! are within a bound.
//!
//! A curve is drawn in one or more panels (plots), each with one or more lines, which have a point for each setting. A
//! round runs every setting once, or more often if its run is short. With fewer than five rounds the samples of each
//! measured time are dealt into "hands", interleaved subsets (see [`hands`]), whose medians show the time's spread.

use serde::{Deserialize, Serialize};

use crate::samples::hands;
use crate::{fit, median};

/// The just noticeable difference of a force, as a share of the force: X. D. Pang, H. Z. Tan and N. I. Durlach, "Manual
/// discrimination of force using active finger motion" (1991), found roughly 7 %.
pub const JUST_NOTICEABLE: f64 = 0.07;
/// A measured order of convergence agrees with the order that theory expects if the two differ by at most this.
pub const NEAR_ORDER: f64 = 0.25;
/// The errors of a line should span at least this number of powers of ten; where they span fewer, the report gives a
/// reason.
pub const DECADES: f64 = 2.0;
/// Only points with relative errors below this belong to the asymptotic part of a line, to which an order of
/// convergence is fitted.
const ASYMPTOTIC: f64 = 0.1;
/// Least slope of ln(error) outside the floor of a line. The floor is the fine end of the line, where the error hardly
/// changes with the knob, because another source of error dominates. Seen from the finest setting, the floor ends at
/// the first two neighbouring points between which the slope exceeds this value. The slope is per unit of ln(knob)
/// where a power law is fitted, and per unit of the knob where each unit of the knob is expected to multiply the error
/// by a constant factor.
const FLOOR: f64 = 0.3;
/// An order is fitted to at most this number of points: the finest ones above the floor.
const MOST_POINTS: usize = 5;
/// An order is fitted to at least this number of points.
const LEAST_POINTS: usize = 3;
/// A fitted order is reported only if the order between each two neighbouring points differs from it by at most this.
const SCATTER: f64 = 1.0;
/// An error that is smaller than both neighbours' errors by more than this factor is small by chance: near such a point
/// the signed error passes through zero.
const CHANCE: f64 = 2.0;
/// Two points cost the same if their costs differ by less than this share of the greater cost.
const SAME_COST: f64 = 0.05;
/// Two points are equally accurate if their errors differ by less than this share of the greater error.
pub const SAME_ERROR: f64 = 0.05;

/// Error and time of each setting of one knob of a scene; the settings were run alternately.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Curve {
    /// Name of the curve, and of its part of the results, for example `tolerance`.
    pub name: String,
    /// Heading of the curve's section in the report.
    pub title: String,
    /// Question that the curve answers: what is varied in which scene, and against which reference the error is
    /// computed.
    pub question: String,
    /// Quantity that the knob sets, with its unit, for example `time step, ms`.
    pub knob: String,
    /// Stage of a time step that the knob affects most; the report shows its time next to that of the whole step.
    pub stage: String,
    /// Points in the order of the knob; each line has its finest setting last.
    pub points: Vec<Point>,
    /// The order of convergence that theory expects, and why; `None` where theory gives no power law.
    pub expected: Option<Expected>,
    /// Reason why theory expects, instead of a power law, that each further unit of the knob multiplies the error by a
    /// constant factor (the share of the error that remains); empty where theory does not expect this.
    pub share: String,
    /// Reason that the report gives where the measured order differs from theory's.
    pub order_reason: String,
    /// Reason that the report gives where the errors span less than [`DECADES`] powers of ten.
    pub span_reason: String,
    /// Largest relative error of the force that a judged setting may have.
    pub bound: f64,
    /// Which settings are judged against the bound.
    pub judged: Judged,
    /// Title of the panel that is not judged because, for comparison, it shows something other than the engine; empty
    /// where there is no such panel.
    pub beside: String,
}

/// Which settings must be within a curve's bound.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Judged {
    /// The finest setting of each line; a coarser one may be near the reference by chance.
    #[default]
    Finest,
    /// The finest setting of each panel, whose lines are judged together as one line.
    FinestOfPanel,
    /// Every setting, where none is finer than another.
    Every,
}

/// A line of a curve's plot: the points of one panel and line name, in the order of the knob.
#[derive(Debug, Clone, PartialEq)]
pub struct Line<'a> {
    /// Title of the panel that the line is in.
    pub panel: &'a str,
    /// Name of the line in its panel.
    pub name: &'a str,
    /// Points of the line.
    pub points: Vec<&'a Point>,
}

/// The power law by which, according to theory, the error falls with the knob.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Expected {
    /// Exponent of the knob.
    pub order: f64,
    /// Reason for the exponent, in words.
    pub law: String,
    /// Whether the law is about the error of the displacements; if not, it is about the error of the force.
    pub is_of_shape: bool,
}

/// One setting of the knob, and what was measured with it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Name of the setting in tables, for example `jacobi to 1e-4`.
    pub setting: String,
    /// Name of the line that the point is on; empty where its panel has one line.
    pub line: String,
    /// Title of the panel that the point is in; empty where the curve has one panel.
    pub panel: String,
    /// Value of the knob.
    pub value: f64,
    /// Largest error of the force on the tool (rigid body that the haptic device leads) in the compared steps, divided
    /// by the largest force of the reference; `None`: nothing is touched, or the error is not finite.
    pub force_error: Option<f64>,
    /// Largest error of a node's displacement, divided by the largest displacement of the reference; `None`:
    /// displacements were not compared, or the error is not finite.
    pub displacement_error: Option<f64>,
    /// Solver iterations of a step, median over the steps.
    pub iterations: f64,
    /// Names of the flags (warnings of a step, for example `not_converged`) that at least one step raised.
    pub flags: Vec<String>,
    /// Time of the curve's stage in each timed step, us; one list for each round.
    pub stage_us: Vec<Vec<f64>>,
    /// Wall time of each step, from passing in the device pose to getting the wrench, us; one list for each round.
    pub step_us: Vec<Vec<f64>>,
    /// Keys of a scene file and the values that this setting gives them. They are given where a preset (named setting
    /// of a scene) may be chosen from the points; empty elsewhere.
    pub keys: Vec<(String, String)>,
    /// Simulated time of one step, s, where time steps differ between the points of the curve; else 0.
    pub simulated_s: f64,
}

impl Point {
    /// Time of a step, ms: the median over the rounds of the median over the steps of each round.
    pub fn step_ms(&self) -> f64 {
        ms(&self.step_us)
    }

    /// Time of the curve's stage in a step, ms: the median over the rounds of the median over the steps of each round.
    pub fn stage_ms(&self) -> f64 {
        ms(&self.stage_us)
    }

    /// Least and greatest time of a step, ms, among the medians of the rounds or, where there are few rounds, of the
    /// hands (see [`hands`]).
    pub fn step_range_ms(&self) -> [f64; 2] {
        let rounds: Vec<f64> = hands(&self.step_us).iter().map(|us| 1e-3 * us).collect();
        [rounds.iter().copied().fold(f64::INFINITY, f64::min), rounds.iter().copied().fold(0.0, f64::max)]
    }

    /// Least and greatest cost: [`Point::step_range_ms`] in the unit of [`Point::cost`].
    pub fn cost_range(&self) -> [f64; 2] {
        let unit = if self.simulated_s > 0.0 { 1e-3 / self.simulated_s } else { 1.0 };
        self.step_range_ms().map(|ms| unit * ms)
    }

    /// Whether this point costs less than another beyond noise: the slowest round (or hand) of this point is cheaper
    /// than the fastest of the other, and its median is at least 5 % cheaper.
    pub fn is_cheaper(&self, other: &Point) -> bool {
        self.cost() < (1.0 - SAME_COST) * other.cost() && self.cost_range()[1] < other.cost_range()[0]
    }

    /// Cost of the setting: milliseconds of a step, or, where steps differ in length, computing time over simulated
    /// time.
    pub fn cost(&self) -> f64 {
        if self.simulated_s > 0.0 { 1e-3 * self.step_ms() / self.simulated_s } else { self.step_ms() }
    }

    /// The error that counts: that of the force or, where the force has no error, that of the displacements.
    pub fn error(&self) -> Option<f64> {
        self.force_error.or(self.displacement_error)
    }

    /// Whether no point of `others` beats this one, by being cheaper and as accurate, or more accurate and no dearer.
    /// Errors within 5 % count as equal; costs are compared by [`Point::is_cheaper`]. A flagged point is never best,
    /// and beats no other point.
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
    /// The lines of the curve, in the order of their first points.
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

    /// Whether each point is a best buy: no other point of its panel is as accurate and cheaper beyond noise, or more
    /// accurate and no dearer. Points of the panel [`Curve::beside`], which does not show the engine, are never best
    /// buys.
    pub fn best(&self) -> Vec<bool> {
        let panel = |name: &str| self.points.iter().filter(|other| other.panel == name).cloned().collect::<Vec<_>>();
        let is_own = |point: &Point| self.beside.is_empty() || point.panel != self.beside;
        self.points.iter().map(|point| is_own(point) && point.is_best_of(&panel(&point.panel))).collect()
    }

    /// Powers of ten that the errors of a line span: the greatest number among all lines.
    pub fn decades(&self) -> f64 {
        self.lines().iter().map(Line::decades).fold(0.0, f64::max)
    }

    /// The judged error of each line, or of each panel as one line (see [`Judged`]); `None`: a setting has no finite
    /// error.
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

    /// The judged lines whose error is beyond the bound, or is missing or NaN.
    pub fn beyond(&self) -> Vec<(Line<'_>, Option<f64>)> {
        let all = self.counted().into_iter();
        all.filter(|(_, error)| error.is_none_or(|error| error > self.bound || error.is_nan())).collect()
    }

    /// Whether there are judged lines and all of them are within the bound.
    pub fn is_within(&self) -> bool {
        !self.counted().is_empty() && self.beyond().is_empty()
    }
}

impl Line<'_> {
    /// The titles of the panel and of the line, joined by a comma; empty ones are left out.
    pub fn title(&self) -> String {
        let parts = [self.panel, self.name];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }

    /// The error of the finest setting, which is the last point.
    pub fn finest(&self) -> Option<f64> {
        self.points.last()?.error()
    }

    /// The greatest error of the line; `None` where a point has no error.
    pub fn worst(&self) -> Option<f64> {
        let errors: Option<Vec<f64>> = self.points.iter().map(|point| point.error()).collect();
        errors?.into_iter().max_by(f64::total_cmp)
    }

    /// Powers of ten between the least and the greatest error above zero; errors that are small by chance are left out.
    pub fn decades(&self) -> f64 {
        let all: Vec<f64> = self.points.iter().filter_map(|point| point.error()).filter(|error| *error > 0.0).collect();
        let is_chance = |k: usize| k > 0 && k + 1 < all.len() && CHANCE * all[k] < all[k - 1].min(all[k + 1]);
        let errors = all.iter().enumerate().filter(|(k, _)| !is_chance(*k)).map(|(_, error)| *error);
        let (low, high) = errors.fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
        if low < high { (high / low).log10() } else { 0.0 }
    }

    /// The order of convergence (exponent of the knob) and the number of points that it was fitted to, by least squares
    /// of the logarithms over the asymptotic part. The order is that of the displacements' error if `is_of_shape`, else
    /// that of the force's error. `None` where fewer than three points are asymptotic, or where neighbouring points
    /// have orders that are far from the fitted one.
    pub fn order(&self, is_of_shape: bool) -> Option<(f64, usize)> {
        let fitted = self.asymptotic(&|point| error_of(point, is_of_shape), f64::ln);
        let order = fit::exponent(&fitted)?;
        let is_one = fitted.windows(2).all(|pair| (local_order(pair) - order).abs() <= SCATTER);
        is_one.then_some((order, fitted.len()))
    }

    /// The order of convergence between each two neighbouring points with errors above zero.
    pub fn local_orders(&self, is_of_shape: bool) -> Vec<f64> {
        let all = self.points.iter().filter_map(|point| Some((point.value, error_of(point, is_of_shape)?)));
        all.filter(|(_, error)| *error > 0.0).collect::<Vec<_>>().windows(2).map(local_order).collect()
    }

    /// The share of the error that remains after one more unit of the knob, and the number of points that it was fitted
    /// to. Points are chosen as for [`Line::order`], but ln(error) is fitted against the knob itself.
    pub fn share(&self) -> Option<(f64, usize)> {
        let fitted = self.asymptotic(&Point::error, |x| x);
        let fitted: Vec<(f64, f64)> = fitted.iter().map(|(x, y)| (x.exp(), *y)).collect();
        Some((fit::exponent(&fitted)?.exp(), fitted.len()))
    }

    /// Knob and error of the points in the asymptotic part, finest first: the finest points above the floor with errors
    /// below a tenth, at most five. Empty if there are fewer than three. `scale` maps the knob to the axis along which
    /// ln(error) falls linearly.
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

/// The order of convergence between the last two points with errors above zero; `None` if there are fewer than two.
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
