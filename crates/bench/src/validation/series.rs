//! A study of refinement: a quantity on ever finer meshes and shorter steps, its limit by extrapolation (Richardson
//! 1911), and whether the limit agrees with a published value.
//!
//! The error of a discretisation of order p falls with size^p. The limit is that of the last two levels. Its
//! uncertainty is the larger of its change since the level before and a tenth of what was extrapolated. To this come
//! the uncertainty of the published value and that of its model. A published value farther away than their sum is not
//! reproduced; and where the sum is large itself, the levels tell nothing, which counts as not reproduced too.

use serde::Serialize;

use crate::limit::limit;

/// Least share of what was extrapolated by which the limit may be off.
const LEAST_SHARE: f64 = 0.1;
/// Relative error by which single precision and the solver's tolerance may move a limit.
pub const PRECISION: f64 = 1e-4;
/// Factor of the change of a limit, where the observed order is less than half or more than twice that of theory: the
/// levels are too coarse, or too irregular, for theory to hold.
const IRREGULAR: f64 = 2.0;
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
    /// The published value was computed on the same mesh with the same steps, to this relative precision.
    SameMesh(f64),
    /// A function of the value has an error of this order in the size of a cell.
    Order(f64, Function),
}

/// The function of a value whose error is a power of the size. A mesh that is too stiff has an error of its
/// stiffness, and stiffness is proportional to one over a deflection under given loads, or to the square of a
/// frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Function {
    /// The value itself.
    Value,
    /// One over the value, which is a deflection under given loads.
    Reciprocal,
    /// One over the root of the value, which grows with the square of a deflection.
    ReciprocalRoot,
    /// The square of the value, which is a frequency.
    Square,
}

impl Function {
    fn of(self, value: f64) -> f64 {
        match self {
            Function::Value => value,
            Function::Reciprocal => 1.0 / value,
            Function::ReciprocalRoot => 1.0 / value.sqrt(),
            Function::Square => value * value,
        }
    }

    /// The value of which the function is `result`.
    fn inverse(self, result: f64) -> f64 {
        match self {
            Function::Value => result,
            Function::Reciprocal => 1.0 / result,
            Function::ReciprocalRoot => 1.0 / (result * result),
            Function::Square => result.sqrt(),
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
    /// Uncertainty of the published value: half a unit of its last digit, or what its source says.
    pub uncertainty: f64,
    /// What is known of how the published value's model differs from the problem as it is posed here.
    pub model: Model,
    /// How the levels approach the limit.
    pub convergence: Convergence,
    /// The levels, from coarse to fine.
    pub levels: Vec<Level>,
}

/// The difference of a published value's model from the problem as it is posed here.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Model {
    /// Known difference, as a share of the published value: the value expected here is that of the model times 1 +
    /// this.
    pub offset: f64,
    /// Uncertainty of that difference, as a share of the published value.
    pub uncertainty: f64,
    /// Why the models differ; empty where they do not.
    pub reason: &'static str,
}

/// What the levels of a quantity say of its published value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Verdict {
    /// The value that is expected here: the published one, with the known difference of its model.
    pub expected: f64,
    /// The limit of the levels; without refinement, the value that is farthest from the expected one.
    pub limit: f64,
    /// Observed order of the last three levels; `None` if there are fewer, or if they do not approach a limit.
    pub order: Option<f64>,
    /// Relative difference of the limit from the expected value.
    pub error: f64,
    /// Relative difference of the finest level from the expected value.
    pub finest: f64,
    /// The part of `bound` that is due to discretisation, single precision and the solver.
    pub numerical: f64,
    /// Greatest relative difference that discretisation, precision, and the uncertainties of value and model explain.
    pub bound: f64,
    /// Whether the published value is reproduced.
    pub is_reproduced: bool,
}

impl Quantity {
    /// A quantity whose published value is exact, by the model that is posed here.
    pub fn new(
        name: &str,
        unit: &'static str,
        published: f64,
        convergence: Convergence,
        levels: Vec<Level>,
    ) -> Quantity {
        Quantity { name: name.into(), unit, published, uncertainty: 0.0, model: Model::default(), convergence, levels }
    }

    /// Judges the levels. Without levels nothing is reproduced.
    pub fn verdict(&self) -> Verdict {
        let expected = self.published * (1.0 + self.model.offset);
        let relative = |value: f64| (value - expected) / expected.abs();
        let order = self.order();
        let (limit, numerical) = match self.convergence {
            Convergence::Exact(within) | Convergence::SameMesh(within) => {
                let far = |level: &&Level| relative(level.value).abs();
                // NaN is the farthest.
                let worst = self.levels.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
                (worst.map_or(f64::NAN, |level| level.value), within)
            }
            Convergence::Order(theory, function) => {
                let of_pair = |pair: &[Level]| {
                    let points = [&pair[0], &pair[1]].map(|level| (level.size, function.of(level.value)));
                    function.inverse(limit(points, theory))
                };
                let limits: Vec<f64> = self.levels.windows(2).map(of_pair).collect();
                let (last, before) = match limits.as_slice() {
                    [.., before, last] => (*last, *before),
                    _ => (f64::NAN, f64::NAN),
                };
                let finest = self.levels.last().map_or(f64::NAN, |level| level.value);
                let is_regular = order.is_some_and(|order| (0.5 * theory..=2.0 * theory).contains(&order));
                let change = (last - before).abs() * if is_regular { 1.0 } else { IRREGULAR };
                let unknown = change.max(LEAST_SHARE * (last - finest).abs());
                (last, unknown / expected.abs() + PRECISION)
            }
        };
        let error = relative(limit);
        let finest = self.levels.last().map_or(f64::NAN, |level| relative(level.value));
        let bound = numerical + self.uncertainty / expected.abs() + self.model.uncertainty;
        let has_flags = self.levels.iter().any(|level| !level.flags.is_empty());
        let is_reproduced = !has_flags && error.abs() <= bound && bound <= GREATEST_BOUND;
        Verdict { expected, limit, order, error, finest, numerical, bound, is_reproduced }
    }

    /// The order that the last three levels show: p for which the differences of the quantity stand to each other as
    /// those of size^p, found by bisection between 0 and 8.
    fn order(&self) -> Option<f64> {
        let Convergence::Order(_, function) = self.convergence else { return None };
        let [.., a, b, c] = self.levels.as_slice() else { return None };
        let [of_a, of_b, of_c] = [a, b, c].map(|level| function.of(level.value));
        let ratio = (of_a - of_b) / (of_b - of_c);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn study(convergence: Convergence, value: impl Fn(f64) -> f64) -> Quantity {
        let level = |size: f64| Level { label: String::new(), size, value: value(size), flags: vec![] };
        Quantity::new("q", "m", 2.0, convergence, [0.4, 0.2, 0.1].map(level).into())
    }

    #[test]
    fn a_power_law_is_extrapolated_to_its_limit_and_its_order_is_found() {
        for (function, value) in [
            (Function::Value, (|h: f64| 2.0 + 0.7 * h * h) as fn(f64) -> f64),
            (Function::Reciprocal, |h| 1.0 / (0.5 + 3.0 * h * h)),
            (Function::ReciprocalRoot, |h| (0.5f64.sqrt() + 0.4 * h * h).powi(-2)),
            (Function::Square, |h| (4.0 + 5.0 * h * h).sqrt()),
        ] {
            let verdict = study(Convergence::Order(2.0, function), value).verdict();
            assert!((verdict.limit - 2.0).abs() < 1e-12 && verdict.error.abs() < 1e-12, "{function:?}: {verdict:?}");
            assert!((verdict.order.unwrap() - 2.0).abs() < 1e-6, "{function:?}: {verdict:?}");
            assert!(verdict.is_reproduced && verdict.finest.abs() > 1e-3, "{function:?}: {verdict:?}");
        }
    }

    #[test]
    fn what_refinement_does_not_explain_is_not_reproduced() {
        let clean = |h: f64| 2.02 + 0.1 * h * h;
        let study = |of: fn(f64) -> f64| study(Convergence::Order(2.0, Function::Value), of);
        assert!(!study(clean).verdict().is_reproduced, "a limit that is one per cent off");
        assert!(
            Quantity { model: Model { uncertainty: 0.011, ..Model::default() }, ..study(clean) }
                .verdict()
                .is_reproduced,
            "a model that explains it"
        );
        assert!(Quantity { uncertainty: 0.021, ..study(clean) }.verdict().is_reproduced, "digits that explain it");
        let offset = |offset: f64| Quantity { model: Model { offset, ..Model::default() }, ..study(clean) }.verdict();
        assert!(
            offset(0.01).is_reproduced && !offset(-0.01).is_reproduced,
            "a difference that is known, with its sign"
        );
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
        // The change of the limit counts twice where the levels do not show the order of theory.
        let slow = study(|h| 2.0 + 0.1 * h.sqrt()).verdict();
        let limit = |h: f64| 2.0 + 0.1 * (h.sqrt() + (h.sqrt() - (2.0 * h).sqrt()) / 3.0);
        let change = (limit(0.1) - limit(0.2)).abs() / 2.0;
        assert!((slow.order.unwrap() - 0.5).abs() < 1e-3 && (slow.bound - 2.0 * change - PRECISION).abs() < 1e-12);
    }

    #[test]
    fn exact_levels_must_all_agree() {
        let exact = |of: fn(f64) -> f64| study(Convergence::Exact(1e-5), of);
        assert!(exact(|h| 2.0 + 1e-5 * h).verdict().is_reproduced);
        assert!(!exact(|h| if h > 0.3 { 2.001 } else { 2.0 }).verdict().is_reproduced, "one level is off");
        assert!(!exact(|h| if h > 0.3 { f64::NAN } else { 2.0 }).verdict().is_reproduced, "one level is NaN");
        let loose = Quantity { uncertainty: 0.11, ..exact(|_| 2.0) };
        assert!(!loose.verdict().is_reproduced, "a bound that tells nothing");
        assert!(!Quantity { levels: vec![], ..exact(|_| 2.0) }.verdict().is_reproduced, "no levels");
    }
}
