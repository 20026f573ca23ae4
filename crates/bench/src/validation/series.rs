//! A study of refinement: a quantity on ever finer meshes and shorter steps, its limit by extrapolation (Richardson
//! 1911), and whether the limit agrees with a published value.
//!
//! The error of a discretisation of order p falls with size^p. The limit of the last two levels is known to what it has
//! moved since the level before, and to no less than a tenth of what was extrapolated. To this come the rounding of the
//! published value and what its model leaves out. A published value farther away than their sum is not reproduced; and
//! where the sum is large itself, the levels tell nothing, which counts as not reproduced too.

use serde::Serialize;

/// Least share of what was extrapolated by which the limit may be off.
const LEAST_SHARE: f64 = 0.1;
/// Relative error by which single precision and the solver's tolerance may move a limit.
const PRECISION: f64 = 1e-4;
/// Greatest bound, as a share of the published value: with a larger one a fault of the engine could hide behind it.
pub const GREATEST_BOUND: f64 = 0.05;

/// A value on one mesh, with one time step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Level {
    /// The mesh, and the step where it changes, in words.
    pub label: String,
    /// Size of a cell, in any unit; steps, where they are refined too, are proportional to it.
    pub size: f64,
    /// The value, in the quantity's unit.
    pub value: f64,
    /// Names of flags that a step raised; a level with flags is not reproduced.
    pub flags: Vec<String>,
}

/// How a value approaches its limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Convergence {
    /// The discretisation represents the solution exactly, so that each level must be within this relative bound:
    /// that of single precision and of the solver.
    Exact(f64),
    /// A quantity of the value has an error of this order in the size of a cell.
    Order(f64, Of),
}

/// The quantity whose error is a power of the size. A mesh that is too stiff has an error of its stiffness, and
/// stiffness is proportional to one over a deflection under given loads, or to the square of a frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Of {
    /// The value itself.
    Value,
    /// One over the value, which is a deflection under given loads.
    Reciprocal,
    /// One over the root of the value, which grows with the square of a deflection.
    ReciprocalRoot,
    /// The square of the value, which is a frequency.
    Square,
}

impl Of {
    fn of(self, value: f64) -> f64 {
        match self {
            Of::Value => value,
            Of::Reciprocal => 1.0 / value,
            Of::ReciprocalRoot => 1.0 / value.sqrt(),
            Of::Square => value * value,
        }
    }

    fn back(self, quantity: f64) -> f64 {
        match self {
            Of::Value => quantity,
            Of::Reciprocal => 1.0 / quantity,
            Of::ReciprocalRoot => 1.0 / (quantity * quantity),
            Of::Square => quantity.sqrt(),
        }
    }
}

/// A published value, and the study of refinement that is to reproduce it.
#[derive(Debug, Clone, Serialize)]
pub struct Quantity {
    /// What it is.
    pub name: String,
    /// Its unit; empty for a number.
    pub unit: &'static str,
    /// The published value.
    pub published: f64,
    /// Greatest error of the published value: half a unit of its last digit, or what its source says.
    pub rounding: f64,
    /// What the published value's model leaves out or has in addition, as a share of the value.
    pub model: f64,
    /// Why the model differs by that share; empty where it does not.
    pub reason: String,
    /// How the levels approach the limit.
    pub convergence: Convergence,
    /// The levels, from coarse to fine.
    pub levels: Vec<Level>,
}

/// What the levels of a quantity say of its published value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Verdict {
    /// The limit of the levels; of exact ones, the value that is farthest from the published one.
    pub limit: f64,
    /// Observed order of the last three levels; `None` if there are fewer, or if they do not approach a limit.
    pub order: Option<f64>,
    /// Relative difference of the limit from the published value.
    pub error: f64,
    /// Relative difference of the finest level from the published value.
    pub finest: f64,
    /// Greatest relative difference that discretisation, rounding and model explain.
    pub bound: f64,
    /// Whether the published value is reproduced.
    pub is_reproduced: bool,
}

impl Quantity {
    /// Judges the levels. Without levels nothing is reproduced.
    pub fn verdict(&self) -> Verdict {
        let relative = |value: f64| (value - self.published) / self.published.abs();
        let has_flags = self.levels.iter().any(|level| !level.flags.is_empty());
        let finest = self.levels.last().map_or(f64::NAN, |level| relative(level.value));
        let known = self.model + self.rounding / self.published.abs();
        let (limit, bound, greatest) = match self.convergence {
            Convergence::Exact(within) => {
                let far = |level: &&Level| relative(level.value).abs();
                // NaN is the farthest.
                let worst = self.levels.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
                (worst.map_or(f64::NAN, |level| level.value), within + known, f64::INFINITY)
            }
            Convergence::Order(order, of) => {
                let limits: Vec<f64> = self.levels.windows(2).map(|pair| limit(pair, order, of)).collect();
                let (last, before) = match limits.as_slice() {
                    [.., before, last] => (*last, *before),
                    _ => (f64::NAN, f64::NAN),
                };
                let value = self.levels.last().map_or(f64::NAN, |level| level.value);
                let unknown = (last - before).abs().max(LEAST_SHARE * (last - value).abs());
                (last, unknown / self.published.abs() + PRECISION + known, GREATEST_BOUND)
            }
        };
        let error = relative(limit);
        let is_reproduced = !has_flags && error.abs() <= bound && bound <= greatest;
        Verdict { limit, order: self.order(), error, finest, bound, is_reproduced }
    }

    /// The order that the last three levels show: p for which the differences of the quantity stand to each other as
    /// those of size^p, found by bisection between 0 and 8.
    fn order(&self) -> Option<f64> {
        let Convergence::Order(_, of) = self.convergence else { return None };
        let [.., a, b, c] = self.levels.as_slice() else { return None };
        let ratio = (of.of(a.value) - of.of(b.value)) / (of.of(b.value) - of.of(c.value));
        let by_order = |p: f64| (a.size.powf(p) - b.size.powf(p)) / (b.size.powf(p) - c.size.powf(p));
        let (mut low, mut high) = (1e-3, 8.0);
        if !(ratio > by_order(low) && ratio < by_order(high)) {
            return None;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if by_order(middle) < ratio { &mut low } else { &mut high }) = middle;
        }
        Some(low)
    }
}

/// The limit of two levels.
fn limit(pair: &[Level], order: f64, of: Of) -> f64 {
    let (coarse, fine) = (&pair[0], &pair[1]);
    let [a, b] = [coarse, fine].map(|level| of.of(level.value));
    of.back(b + (b - a) / ((coarse.size / fine.size).powf(order) - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(convergence: Convergence, value: impl Fn(f64) -> f64) -> Quantity {
        let level = |size: f64| Level { label: String::new(), size, value: value(size), flags: vec![] };
        Quantity {
            name: "q".into(),
            unit: "m",
            published: 2.0,
            rounding: 0.0,
            model: 0.0,
            reason: String::new(),
            convergence,
            levels: [0.4, 0.2, 0.1].map(level).into(),
        }
    }

    #[test]
    fn a_power_law_is_extrapolated_to_its_limit_and_its_order_is_found() {
        for (of, value) in [
            (Of::Value, (|h: f64| 2.0 + 0.7 * h * h) as fn(f64) -> f64),
            (Of::Reciprocal, |h| 1.0 / (0.5 + 3.0 * h * h)),
            (Of::ReciprocalRoot, |h| (0.5f64.sqrt() + 0.4 * h * h).powi(-2)),
            (Of::Square, |h| (4.0 + 5.0 * h * h).sqrt()),
        ] {
            let verdict = study(Convergence::Order(2.0, of), value).verdict();
            assert!((verdict.limit - 2.0).abs() < 1e-12 && verdict.error.abs() < 1e-12, "{of:?}: {verdict:?}");
            assert!((verdict.order.unwrap() - 2.0).abs() < 1e-6, "{of:?}: {verdict:?}");
            assert!(verdict.is_reproduced && verdict.finest.abs() > 1e-3, "{of:?}: {verdict:?}");
        }
    }

    #[test]
    fn what_refinement_does_not_explain_is_not_reproduced() {
        let clean = |h: f64| 2.02 + 0.1 * h * h;
        let study = |of: fn(f64) -> f64| study(Convergence::Order(2.0, Of::Value), of);
        assert!(!study(clean).verdict().is_reproduced, "a limit that is one per cent off");
        assert!(Quantity { model: 0.011, ..study(clean) }.verdict().is_reproduced, "a model that explains it");
        assert!(Quantity { rounding: 0.021, ..study(clean) }.verdict().is_reproduced, "digits that explain it");
        let mut flagged = study(|h| 2.0 + 0.1 * h * h);
        assert!(flagged.verdict().is_reproduced);
        flagged.levels[0].flags.push("inverted".into());
        assert!(!flagged.verdict().is_reproduced, "a flag");
        let coarse = study(|h| 2.0 + 2.0 * h + 6.0 * h * h).verdict();
        assert!(!coarse.is_reproduced && coarse.bound > GREATEST_BOUND, "levels that tell nothing: {coarse:?}");
        assert!(!study(|_| f64::NAN).verdict().is_reproduced, "not a number");
        let few = Quantity { levels: study(|_| 2.0).levels[..2].to_vec(), ..study(|_| 2.0) };
        assert!(!few.verdict().is_reproduced, "two levels do not show that they converge");
        assert_eq!(study(|h| 2.0 + (40.0 * h).sin()).verdict().order, None);
    }

    #[test]
    fn exact_levels_must_all_agree() {
        let exact = |of: fn(f64) -> f64| study(Convergence::Exact(1e-5), of);
        assert!(exact(|h| 2.0 + 1e-5 * h).verdict().is_reproduced);
        assert!(!exact(|h| if h > 0.3 { 2.001 } else { 2.0 }).verdict().is_reproduced, "one level is off");
        assert!(!exact(|h| if h > 0.3 { f64::NAN } else { 2.0 }).verdict().is_reproduced, "one level is NaN");
        assert!(!Quantity { levels: vec![], ..exact(|_| 2.0) }.verdict().is_reproduced, "no levels");
    }
}
