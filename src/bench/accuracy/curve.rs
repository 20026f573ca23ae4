//! Error against run time: a curve, its points, and what they say.

use serde::{Deserialize, Serialize};

use crate::bench::{fit, median};

/// Changes of a force that a person just notices, of the force (see README, "bench").
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

/// What one knob of a scene buys: error and time of each of its settings, measured turn by turn.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Curve {
    /// Short name, as in `--only`: `tolerance`.
    pub name: String,
    /// Heading.
    pub title: String,
    /// What was asked, of which scene, and what the error is measured against.
    pub question: String,
    /// What the settings are numbers of, with its unit: `time step, ms`.
    pub knob: String,
    /// Which stage the knob is about; its time stands beside the step's.
    pub stage: String,
    /// Setting by setting, in the order of the knob.
    pub points: Vec<Point>,
    /// The order of convergence that theory expects of the force, and why; `None`: the knob has none.
    pub expected: Option<Expected>,
    /// Instead of a power: by which law the error falls by a share with each unit of the knob; empty: by none.
    pub share: String,
    /// Why the order is another, or the errors span less than two decades; empty where neither is so.
    pub reason: String,
    /// The most accurate setting of each line must have a force within this of the reference, of it.
    pub bound: f64,
    /// Whether the lines are one set of settings: then one of all must be within the bound.
    pub is_one: bool,
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

    /// From the fastest to the slowest round, milliseconds a step.
    pub fn step_range_ms(&self) -> [f64; 2] {
        let rounds: Vec<f64> = self.step_us.iter().map(|round| 1e-3 * median(round)).collect();
        [rounds.iter().copied().fold(f64::INFINITY, f64::min), rounds.iter().copied().fold(0.0, f64::max)]
    }

    /// What is paid: milliseconds of a step, or where steps differ in length their time over the time that they simulate.
    pub fn cost(&self) -> f64 {
        if self.simulated_s > 0.0 { 1e-3 * self.step_ms() / self.simulated_s } else { self.step_ms() }
    }

    /// The error that counts: of the force, or of the displacements where nothing is touched.
    pub fn error(&self) -> Option<f64> {
        self.force_error.or(self.displacement_error)
    }

    /// Whether no other is at once cheaper and no less accurate, or as cheap and more accurate; flagged ones do not count.
    fn is_best_of(&self, others: &[Point]) -> bool {
        let Some(error) = self.error().filter(|_| self.flags.is_empty()) else { return false };
        let is_better = |other: &Point| match other.error().filter(|_| other.flags.is_empty()) {
            Some(its) => its <= error && other.cost() <= self.cost() && (its < error || other.cost() < self.cost()),
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

    /// Which points are the best buys among those of their panel: no other is both faster and more accurate.
    pub fn best(&self) -> Vec<bool> {
        let panel = |name: &str| self.points.iter().filter(|other| other.panel == name).cloned().collect::<Vec<_>>();
        self.points.iter().map(|point| point.is_best_of(&panel(&point.panel))).collect()
    }

    /// Powers of ten between the least and the greatest error above zero.
    pub fn decades(&self) -> f64 {
        let errors = || self.points.iter().filter_map(Point::error).filter(|error| *error > 0.0);
        let (low, high) = errors().fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
        if low < high { (high / low).log10() } else { 0.0 }
    }

    /// Lines whose most accurate setting is beyond the bound, or has no error that is a number, and that error.
    pub fn beyond(&self) -> Vec<(Line<'_>, Option<f64>)> {
        if self.is_one {
            let all = Line { panel: "", name: "all", points: self.points.iter().collect() };
            let least = all.least();
            return if least.is_none_or(|least| least > self.bound) { vec![(all, least)] } else { Vec::new() };
        }
        let all = self.lines().into_iter().map(|line| line.least()).zip(self.lines());
        let beyond = all.filter(|(least, _)| least.is_none_or(|least| least > self.bound));
        beyond.map(|(least, line)| (line, least)).collect()
    }

    /// Whether every line is within the bound.
    pub fn is_within(&self) -> bool {
        !self.points.is_empty() && self.beyond().is_empty()
    }
}

impl Line<'_> {
    /// Its panel and its name, as far as it has them.
    pub fn title(&self) -> String {
        let parts = [self.panel, self.name];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }

    /// The least error.
    pub fn least(&self) -> Option<f64> {
        self.points.iter().filter_map(|point| point.error()).min_by(f64::total_cmp)
    }

    /// The power of the knob by which the error falls, of the displacements or of the force, and of how many points: least
    /// squares of the logarithms over the asymptotic part; `None` where that has fewer than three.
    pub fn order(&self, is_of_shape: bool) -> Option<(f64, usize)> {
        let error = |point: &Point| if is_of_shape { point.displacement_error } else { point.error() };
        let fitted = self.asymptotic(&error, f64::ln);
        Some((fit::exponent(&fitted)?, fitted.len()))
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

fn ms(rounds: &[Vec<f64>]) -> f64 {
    1e-3 * median(&rounds.iter().map(|round| median(round)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(value: f64, ms: f64, error: Option<f64>) -> Point {
        Point { value, force_error: error, step_us: vec![vec![1e3 * ms]], ..Point::default() }
    }

    fn curve(points: Vec<Point>) -> Curve {
        Curve { points, bound: 1e-3, ..Curve::default() }
    }

    #[test]
    fn the_best_buys_are_those_that_nothing_beats_in_both() {
        let mut flagged = point(1.0, 0.5, Some(1e-6));
        flagged.flags = vec!["not_converged".into()];
        let mut elsewhere = point(1.0, 9.0, Some(0.9));
        elsewhere.panel = "stiff".into();
        let all = vec![
            point(1.0, 1.0, Some(0.1)),
            point(2.0, 2.0, Some(0.2)),
            point(3.0, 2.0, Some(0.01)),
            point(4.0, 2.5, Some(0.01)),
            point(5.0, 3.0, None),
            flagged,
            elsewhere,
        ];
        assert_eq!(curve(all).best(), [true, false, true, false, false, false, true]);
    }

    #[test]
    fn steps_of_different_lengths_are_paid_by_the_time_they_simulate() {
        let mut long = point(1.0, 2.0, Some(0.1));
        long.simulated_s = 0.01;
        let short = Point { simulated_s: 0.001, ..point(1.0, 1.0, Some(0.1)) };
        assert!((long.cost() - 0.2).abs() < 1e-12 && (short.cost() - 1.0).abs() < 1e-12);
        assert_eq!(curve(vec![long, short]).best(), [true, false]);
    }

    #[test]
    fn orders_are_fitted_where_errors_fall_and_not_to_floor_or_ceiling() {
        let second = |h: f64| Some((0.5 * h * h).max(1e-5));
        let points = [1.0, 0.4, 0.2, 0.1, 0.05, 0.001, 0.0005].map(|h| point(h, 1.0, second(h))).to_vec();
        let all = curve(points.clone());
        let (order, count) = all.lines()[0].order(false).unwrap();
        // From 0.4, whose error is under a tenth; 0.001 is where the floor begins, and is not as fine as it says.
        assert!(count == 5 && order < 2.0, "{order} of {count}");
        let all = curve(points[..5].to_vec());
        let (order, count) = all.lines()[0].order(false).unwrap();
        assert!((order - 2.0).abs() < 1e-9 && count == 4, "{order} of {count}");
        assert!((all.decades() - (0.5f64 / 0.5 / 0.0025).log10()).abs() < 1e-9);
        // The other way round, and of the displacements.
        let turned = curve(points[..5].iter().rev().cloned().collect());
        assert!((turned.lines()[0].order(false).unwrap().0 - 2.0).abs() < 1e-9);
        assert!(turned.lines()[0].order(true).is_none());
        assert!(curve(vec![point(1.0, 1.0, Some(0.05)); 2]).lines()[0].order(false).is_none());
    }

    #[test]
    fn shares_are_what_a_unit_leaves() {
        let points = (1..=6).map(|n| point(f64::from(n), 1.0, Some(0.2f64.powi(n)))).collect();
        let (share, count) = curve(points).lines()[0].share().unwrap();
        assert!((share - 0.2).abs() < 1e-9 && count == 5, "{share} of {count}");
    }

    #[test]
    fn a_line_beyond_its_bound_or_without_a_number_spoils_the_verdict() {
        let named = |line: &str, error| Point { line: line.into(), ..point(1.0, 1.0, error) };
        let good = vec![named("a", Some(0.5)), named("a", Some(1e-4)), named("b", Some(9e-4))];
        assert!(curve(good.clone()).is_within());
        for bad in [Some(2e-3), None] {
            let all = curve([good.clone(), vec![named("c", bad)]].concat());
            let beyond = all.beyond();
            assert!(!all.is_within() && beyond.len() == 1 && beyond[0].0.name == "c" && beyond[0].1 == bad);
        }
        assert!(!curve(Vec::new()).is_within());
    }
}
