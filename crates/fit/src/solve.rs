//! The fit: nonlinear least squares by the method of Levenberg (1944) and Marquardt (1963), as in MINPACK. The Jacobian
//! is that of forward differences. Without bounds a value is its magnitude, so that it keeps its sign; with bounds it is
//! a sine between them (James and Roos 1975).

use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use palpate::scene::dotted;
use palpate::{Context, Error, Flags, Result, SceneBuilder};
use serde::Serialize;

use crate::measured::Measured;
use crate::simulated::{Simulated, simulate};
use crate::students_t;

/// Relative step of the forward differences. The solver's tolerance and a time step's contacts change forces by some
/// 1e-4 of the peak, which this step must exceed.
const DIFFERENCE: f64 = 0.02;
/// Relative change of all values, and of the sum of squares, below which the fit has converged.
const STEP_TOLERANCE: f64 = 1e-3;
const SQUARES_TOLERANCE: f64 = 1e-5;
/// Most simulations of a fit of one value, and what each further value adds.
const MOST_SIMULATIONS: u32 = 15;
/// Ratio of the least to the greatest singular value of the scaled Jacobian below which the force does not tell values
/// apart.
const INDEPENDENT: f64 = 1e-3;
/// Fewest points whose residuals can be said to have a pattern, or none.
const FEW: usize = 12;
/// Distance from a bound, as a share of the range between the bounds, below which a value counts as at the bound.
const AT_BOUND: f64 = 0.01;
/// Autocorrelation of successive residuals, in its standard errors, above which they have a pattern: random residuals
/// have such a one in one of a thousand fits.
const PATTERN: f64 = 3.3;
/// Scatter, as a share of the greatest force, below which a pattern is not reported.
const FINE_SCATTER: f64 = 0.002;
/// Scatter, as a share of the greatest force, above which residuals with a pattern, or any, mean that nothing fits.
const COARSE_SCATTER: f64 = 0.05;
const COARSEST_SCATTER: f64 = 0.2;

/// A value of a scene that is to be fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Free {
    /// Dotted key, such as `body.material.young`.
    pub key: String,
    /// Least and greatest value.
    pub bounds: Option<(f64, f64)>,
}

/// A fitted value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Dotted key.
    pub key: String,
    /// The value in the scene as it was given.
    pub initial: f64,
    /// The value with the least sum of squares.
    pub value: f64,
    /// Standard error of the value, from the scatter of the measurement about the curve.
    pub standard_error: f64,
    /// Interval that holds the true value in 95 % of cases, if the residuals are independent.
    pub interval: [f64; 2],
}

/// How well the fitted curve agrees with the measured one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// What is left looks like noise.
    Fits,
    /// What is left has a pattern: the scene's curve has another shape, and the intervals are too narrow.
    OtherShape,
    /// No value gives a curve like the measured one.
    NoValueFits,
    /// There are too few points to tell whether what is left has a pattern.
    FewPoints,
    /// A value ended at one of its bounds; its interval is cut off there.
    AtBound,
    /// The fit did not converge within its simulations.
    NotConverged,
}

/// Result of a fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fit {
    /// The fitted values.
    pub estimates: Vec<Estimate>,
    /// Correlation of the errors of each two values.
    pub correlation: Vec<Vec<f64>>,
    /// Root of the mean square of the residuals, N.
    pub scatter: f64,
    /// How well the curves agree.
    pub verdict: Verdict,
    /// Force of the fitted scene at each measured point, N.
    pub forces: Vec<f64>,
    /// Number of measured points that lie beyond the curve of the fitted scene, which is extrapolated there by at most a
    /// twentieth of its length.
    pub extrapolated: usize,
    /// Number of simulations.
    pub simulations: u32,
    /// Flags of the steps of the fitted scene.
    #[serde(skip)]
    pub flags: Flags,
}

/// Fits values of a scene to a measured curve. `tables` are those of the scene file `file`; the values that they have
/// are where the search begins.
///
/// # Errors
/// A key to fit has no number, its value is not between its bounds or is zero; the scene touches nothing or does not
/// press as deep as was measured; or a simulation failed.
pub fn fit(
    file: PathBuf,
    tables: &toml::Table,
    measured: &Measured,
    free: &[Free],
    context: &Arc<Context>,
) -> Result<Fit> {
    let mut initial = Vec::new();
    for (k, Free { key, .. }) in free.iter().enumerate() {
        if free[..k].iter().any(|other| other.key == *key) {
            return Err(Error::key(&file, key, "is given twice as a free value", "give it once"));
        }
        let value = dotted::get(tables, key)?;
        let number = value.as_ref().and_then(|value| value.as_float().or(value.as_integer().map(|whole| whole as f64)));
        initial.push(number.ok_or_else(|| {
            let problem = "has no number in the scene, from which the search could begin";
            Error::key(&file, key, problem, "give the key a likely value")
        })?);
    }
    fit_model(measured, free, &initial, |values| {
        let mut tables = tables.clone();
        for (Free { key, .. }, value) in free.iter().zip(values) {
            dotted::set(&mut tables, key, toml::Value::Float(*value))?;
        }
        let mut builder = SceneBuilder::new(file.clone());
        builder.tables(&tables)?;
        simulate(context, &builder.build()?, measured)
    })
}

/// Fits the values of a model, which gives the forces at the measured points.
fn fit_model(
    measured: &Measured,
    free: &[Free],
    initial: &[f64],
    model: impl Fn(&[f64]) -> Result<Simulated>,
) -> Result<Fit> {
    let (points, count) = (measured.points.len(), free.len());
    if count == 0 || points <= count {
        return Err(Error::Usage(format!(
            "{count} values cannot be fitted to {points} points; give one value or more, and more points than values"
        )));
    }
    let scales = free.iter().zip(initial).map(|(free, value)| Scale::of(free, *value)).collect::<Result<Vec<_>>>()?;
    let most = MOST_SIMULATIONS * count as u32;
    let problem = Problem {
        measured,
        parameters: DVector::from_iterator(count, scales.iter().map(|scale| scale.start)),
        scales,
        trials: RefCell::default(),
        most,
        model,
    };
    // A model that fails at the given values is an error; one that fails at others has a very large residual.
    problem.model_at(&problem.values(&problem.parameters))?;
    let optimiser = LevenbergMarquardt::new().with_ftol(SQUARES_TOLERANCE).with_xtol(STEP_TOLERANCE);
    let (problem, report) = optimiser.minimize(problem);
    let is_converged = match report.termination {
        TerminationReason::User(_) | TerminationReason::LostPatience => false,
        TerminationReason::Numerical(why) | TerminationReason::WrongDimensions(why) => {
            return Err(Error::Simulation(format!("the fit failed: {why}")));
        }
        _ => true,
    };
    problem.finish(free, initial, is_converged)
}

/// How a value follows from an unbounded parameter.
struct Scale {
    /// The value where the parameter is `start`, or the bounds.
    value: f64,
    bounds: Option<(f64, f64)>,
    start: f64,
}

impl Scale {
    fn of(free: &Free, value: f64) -> Result<Scale> {
        let wrong = |problem: String| Err(Error::Usage(format!("{}: {problem}", free.key)));
        match free.bounds {
            None if value == 0.0 => wrong("is 0 in the scene, from which no search begins; give a likely value".into()),
            None => Ok(Scale { value, bounds: None, start: 1.0 }),
            Some((low, high)) if low < value && value < high => {
                let start = (2.0 * (value - low) / (high - low) - 1.0).asin();
                Ok(Scale { value, bounds: Some((low, high)), start })
            }
            Some((low, high)) => {
                wrong(format!("is {value} in the scene, not between its bounds {low} and {high}; change one"))
            }
        }
    }

    fn value(&self, parameter: f64) -> f64 {
        match self.bounds {
            None => self.value * parameter.abs().max(1e-6),
            Some((low, high)) => low + 0.5 * (high - low) * (1.0 + parameter.sin()),
        }
    }

    /// A value a little further from its bounds.
    fn next(&self, value: f64) -> f64 {
        match self.bounds {
            None => value * (1.0 + DIFFERENCE),
            Some((low, high)) => {
                let range = high - low;
                let step = DIFFERENCE * value.abs().clamp(0.05 * range, range);
                if value > 0.5 * (low + high) { value - step } else { value + step }
            }
        }
    }

    /// Derivative of the value by the parameter.
    fn slope(&self, parameter: f64) -> f64 {
        match self.bounds {
            None => self.value * parameter.signum(),
            Some((low, high)) => 0.5 * (high - low) * parameter.cos(),
        }
    }
}

/// Covariance of the fitted values, from the derivatives J of the forces and the residuals: the estimate HC3 of MacKinnon
/// and White (1985), which holds where noise grows with the force, too. `None` as for [`inverse_of_normal`].
fn covariance(j: &DMatrix<f64>, residuals: &[f64]) -> Option<DMatrix<f64>> {
    let inverse = inverse_of_normal(j)?;
    let mut weighted = j.clone();
    for (k, residual) in residuals.iter().enumerate() {
        let row = j.row(k);
        let leverage = (row * &inverse * row.transpose())[(0, 0)];
        let weight = residual / (1.0 - leverage).max(f64::EPSILON);
        weighted.row_mut(k).scale_mut(weight);
    }
    Some(&inverse * (weighted.transpose() * weighted) * &inverse)
}

/// The inverse of J^T J; `None` where a column of J is zero, or the columns are so nearly dependent that differences of
/// simulations cannot tell them apart.
fn inverse_of_normal(j: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let norms: Vec<f64> = j.column_iter().map(|column| column.norm()).collect();
    let mut scaled = j.clone();
    for (mut column, norm) in scaled.column_iter_mut().zip(&norms) {
        column /= *norm;
    }
    let svd = scaled.svd(false, true);
    let (least, most) = (svd.singular_values.min(), svd.singular_values.max());
    // A column that is zero has become NaN.
    if least.is_nan() || least <= INDEPENDENT * most {
        return None;
    }
    let v = svd.v_t?.transpose();
    let weights = DMatrix::from_diagonal(&svd.singular_values.map(|s| s.powi(-2)));
    let mut inverse = &v * weights * v.transpose();
    for (i, a) in norms.iter().enumerate() {
        for (k, b) in norms.iter().enumerate() {
            inverse[(i, k)] /= a * b;
        }
    }
    Some(inverse)
}

/// A simulation that was made: its values, and its forces; `None` where it failed.
type Trial = (Vec<f64>, Option<Simulated>);

struct Problem<'a, M> {
    measured: &'a Measured,
    scales: Vec<Scale>,
    parameters: DVector<f64>,
    trials: RefCell<Vec<Trial>>,
    most: u32,
    model: M,
}

impl<M: Fn(&[f64]) -> Result<Simulated>> Problem<'_, M> {
    fn values(&self, parameters: &DVector<f64>) -> Vec<f64> {
        self.scales.iter().zip(parameters).map(|(scale, parameter)| scale.value(*parameter)).collect()
    }

    /// The forces of the model at these values, from an earlier trial if there was one.
    fn model_at(&self, values: &[f64]) -> Result<Simulated> {
        let known = self.trials.borrow().iter().find(|(of, _)| of == values).map(|(_, known)| known.clone());
        if let Some(known) = known {
            return known.ok_or_else(|| Error::Simulation("a simulation failed".into()));
        }
        let made = (self.model)(values);
        self.trials.borrow_mut().push((values.to_vec(), made.as_ref().ok().cloned()));
        made
    }

    /// Simulated less measured force at each point.
    fn residuals_of(&self, simulated: &Simulated) -> Vec<f64> {
        simulated.forces.iter().zip(&self.measured.points).map(|(force, (_, known))| force - known).collect()
    }

    /// The residuals of the model at these values, which are very large where it fails; `None` where no more simulations are allowed.
    fn residuals_at(&self, values: &[f64]) -> Option<DVector<f64>> {
        let is_known = self.trials.borrow().iter().any(|(of, _)| of == values);
        if !is_known && self.trials.borrow().len() >= self.most as usize {
            return None;
        }
        let all = match self.model_at(values) {
            Ok(simulated) => self.residuals_of(&simulated),
            Err(_) => vec![1e3 * self.measured.peak().max(f64::MIN_POSITIVE); self.measured.points.len()],
        };
        Some(DVector::from_vec(all))
    }

    /// Whether the simulation with these values was made, and failed.
    fn has_failed(&self, values: &[f64]) -> bool {
        self.trials.borrow().iter().any(|(of, known)| of == values && known.is_none())
    }

    /// Derivatives of the forces by the values, by forward differences, or backward ones where the simulation ahead
    /// fails; `None` where both fail, or no more simulations are allowed.
    fn derivatives(&self, values: &[f64]) -> Option<DMatrix<f64>> {
        let here = self.residuals_at(values)?;
        let mut columns = Vec::new();
        for (k, scale) in self.scales.iter().enumerate() {
            let ahead = scale.next(values[k]) - values[k];
            let column = [ahead, -ahead].into_iter().find_map(|step| {
                let mut other = values.to_vec();
                other[k] += step;
                let there = self.residuals_at(&other)?;
                (!self.has_failed(&other)).then(|| (there - &here) / step)
            });
            columns.push(column?);
        }
        Some(DMatrix::from_columns(&columns))
    }

    /// The trial with the least sum of squares: its values and its forces.
    fn best(&self) -> Result<(Vec<f64>, Simulated)> {
        let squares = |simulated: &Simulated| self.residuals_of(simulated).iter().map(|r| r * r).sum::<f64>();
        let trials = self.trials.borrow();
        let done = trials.iter().filter_map(|(values, known)| Some((values, known.as_ref()?)));
        let best = done.min_by(|(_, a), (_, b)| squares(a).total_cmp(&squares(b)));
        let (values, simulated) = best.ok_or_else(|| Error::Simulation("no simulation of the fit succeeded".into()))?;
        Ok((values.clone(), simulated.clone()))
    }

    fn finish(&self, free: &[Free], initial: &[f64], is_converged: bool) -> Result<Fit> {
        let (values, simulated) = self.best()?;
        let residuals = self.residuals_of(&simulated);
        let (points, count) = (residuals.len(), values.len());
        // Where no further simulation is allowed, the derivatives of an earlier step stand in for those here.
        let trials = self.trials.borrow().clone();
        let earlier =
            || trials.iter().rev().filter(|(_, known)| known.is_some()).find_map(|(of, _)| self.derivatives(of));
        let derivatives = self.derivatives(&values).or_else(earlier);
        let covariance = derivatives.and_then(|j| covariance(&j, &residuals));
        let Some(covariance) = covariance else {
            let keys = free.iter().map(|free| free.key.as_str()).collect::<Vec<_>>().join(", ");
            return Err(Error::Simulation(format!(
                "the force does not tell {keys}: it hardly changes with a value, or two values have the same effect; free other keys"
            )));
        };
        let t = students_t::two_sided_95(points - count);
        let estimate = |k: usize| {
            let (value, standard_error) = (values[k], covariance[(k, k)].max(0.0).sqrt());
            let (low, high) = self.scales[k].bounds.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let interval = [value - t * standard_error, value + t * standard_error].map(|end| end.clamp(low, high));
            Estimate { key: free[k].key.clone(), initial: initial[k], value, standard_error, interval }
        };
        let correlation = |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        let scatter = (residuals.iter().map(|r| r * r).sum::<f64>() / points as f64).sqrt();
        let is_at_bound = |(scale, value): (&Scale, &f64)| {
            scale.bounds.is_some_and(|(low, high)| (value - low).min(high - value) < AT_BOUND * (high - low))
        };
        let verdict = match () {
            () if !is_converged => Verdict::NotConverged,
            () if self.scales.iter().zip(&values).any(is_at_bound) => Verdict::AtBound,
            () => self.verdict(&residuals, scatter),
        };
        Ok(Fit {
            estimates: (0..count).map(estimate).collect(),
            correlation: (0..count).map(|i| (0..count).map(|j| correlation(i, j)).collect()).collect(),
            scatter,
            verdict,
            forces: simulated.forces,
            extrapolated: simulated.extrapolated,
            simulations: self.trials.borrow().len() as u32,
            flags: simulated.flags,
        })
    }

    fn verdict(&self, residuals: &[f64], scatter: f64) -> Verdict {
        let mut order: Vec<usize> = (0..residuals.len()).collect();
        order.sort_by(|a, b| self.measured.points[*a].0.total_cmp(&self.measured.points[*b].0));
        let sorted: Vec<f64> = order.iter().map(|at| residuals[*at]).collect();
        let products: f64 = sorted.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let squares: f64 = sorted.iter().map(|r| r * r).sum();
        let has_pattern = products > PATTERN / (sorted.len() as f64).sqrt() * squares;
        let share = scatter / self.measured.peak();
        match () {
            () if share > COARSEST_SCATTER || (has_pattern && share > COARSE_SCATTER) => Verdict::NoValueFits,
            () if has_pattern && share > FINE_SCATTER => Verdict::OtherShape,
            () if sorted.len() < FEW && share > FINE_SCATTER => Verdict::FewPoints,
            () => Verdict::Fits,
        }
    }
}

impl<M: Fn(&[f64]) -> Result<Simulated>> LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, M> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.residuals_at(&self.values(&self.parameters))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let mut jacobian = self.derivatives(&self.values(&self.parameters))?;
        for ((mut column, scale), parameter) in jacobian.column_iter_mut().zip(&self.scales).zip(&self.parameters) {
            column *= scale.slope(*parameter);
        }
        Some(jacobian)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::Abscissa;

    fn free(keys: &[&str]) -> Vec<Free> {
        keys.iter().map(|key| Free { key: (*key).into(), bounds: None }).collect()
    }

    /// Numbers with mean 0 and standard deviation 1, the same in every run.
    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// A sphere in an elastic half-space (Hertz 1881) behind a spring, and drag.
    fn press(young: f64, drag: f64, depth: f64) -> f64 {
        let free = young * 0.1 * depth.powf(1.5);
        free / (1.0 + free / 50.0) + drag * (1.0 - depth)
    }

    fn curve(of: impl Fn(f64) -> f64) -> Measured {
        let points = (1..=40).map(|k| f64::from(k) / 40.0).map(|x| (x, of(x))).collect();
        Measured::of(Abscissa::Indentation, points).unwrap()
    }

    fn simulated(measured: &Measured, of: impl Fn(f64) -> f64) -> Simulated {
        Simulated {
            forces: measured.points.iter().map(|(x, _)| of(*x)).collect(),
            extrapolated: 0,
            flags: Flags::default(),
        }
    }

    /// Fits one value to 40 curves with 2 % noise, of the peak or of each force; returns how many intervals hold the true
    /// value.
    fn held(is_proportional: bool) -> usize {
        let holds = |k: u64| {
            let (mut random, truth) = (noise(k), 5.0 * 40f64.powf(k as f64 / 39.0));
            let peak = press(truth, 0.0, 1.0);
            let mut measured = curve(|x| press(truth, 0.0, x));
            for (_, force) in &mut measured.points {
                *force += 0.02 * random() * if is_proportional { *force } else { peak };
            }
            let model = |values: &[f64]| Ok(simulated(&measured, |x| press(values[0], 0.0, x)));
            let fit = fit_model(&measured, &free(&["young"]), &[20.0], model).unwrap();
            let estimate = &fit.estimates[0];
            assert!((estimate.value / truth - 1.0).abs() < 0.03, "{truth}: {estimate:?}");
            assert!(fit.simulations <= 15, "{truth}: {} simulations", fit.simulations);
            assert_eq!(fit.verdict, Verdict::Fits, "{truth}: {fit:?}");
            estimate.interval[0] < truth && truth < estimate.interval[1]
        };
        (0..40).filter(|k| holds(*k)).count()
    }

    #[test]
    fn one_value_is_found_with_few_simulations_and_an_interval_that_holds_it() {
        for is_proportional in [false, true] {
            let held = held(is_proportional);
            assert!((35..40).contains(&held), "{held} of 40 intervals hold the true value");
        }
    }

    #[test]
    fn two_values_and_their_correlation_are_found() {
        let measured = curve(|x| press(30.0, 0.5, x));
        let fit = fit_model(&measured, &free(&["young", "drag"]), &[20.0, 2.0], |values| {
            Ok(simulated(&measured, |x| press(values[0], values[1], x)))
        })
        .unwrap();
        let [young, drag] = &fit.estimates[..] else { panic!("{fit:?}") };
        assert!((young.value - 30.0).abs() < 0.05 && (drag.value - 0.5).abs() < 0.005, "{fit:?}");
        assert!(fit.correlation[0][0] > 0.999 && fit.correlation[0][1] < -0.1 && fit.verdict == Verdict::Fits);
    }

    #[test]
    fn bounds_are_kept() {
        let measured = curve(|x| press(30.0, 0.0, x));
        let within = |low: f64, high: f64| {
            let free = [Free { key: "young".into(), bounds: Some((low, high)) }];
            fit_model(&measured, &free, &[20.0], |values| {
                assert!(low <= values[0] && values[0] <= high);
                Ok(simulated(&measured, |x| press(values[0], 0.0, x)))
            })
        };
        assert!((within(1.0, 200.0).unwrap().estimates[0].value - 30.0).abs() < 0.05);
        let cut = within(10.0, 25.0).unwrap();
        assert!(cut.estimates[0].value > 24.5 && cut.verdict == Verdict::AtBound, "{cut:?}");
        assert!(cut.estimates[0].interval[1] <= 25.0);
        assert!(within(21.0, 25.0).unwrap_err().to_string().contains("not between its bounds"));
    }

    #[test]
    fn a_curve_that_no_value_fits_is_said_so() {
        let verdict = |of: &dyn Fn(f64) -> f64| {
            let measured = curve(of);
            let model = |values: &[f64]| Ok(simulated(&measured, |x| press(values[0], 0.0, x)));
            fit_model(&measured, &free(&["young"]), &[20.0], model).unwrap().verdict
        };
        assert_eq!(verdict(&|x| press(30.0, 0.0, x)), Verdict::Fits);
        assert_eq!(verdict(&|x| 3.0 * (1.0 - x)), Verdict::NoValueFits);
        assert_eq!(verdict(&|x| (9.0 * x).sin()), Verdict::NoValueFits);
        assert_eq!(verdict(&|x| press(30.0, 0.1, x)), Verdict::OtherShape);
    }

    #[test]
    fn a_value_without_effect_and_a_model_that_fails_are_errors() {
        let measured = curve(|x| press(30.0, 0.0, x));
        let idle = fit_model(&measured, &free(&["name"]), &[1.0], |_| Ok(simulated(&measured, |x| x)));
        assert!(idle.unwrap_err().to_string().contains("does not tell name"));
        let product = fit_model(&measured, &free(&["a", "b"]), &[4.0, 5.0], |values| {
            Ok(simulated(&measured, |x| press(values[0] * values[1], 0.0, x)))
        });
        assert!(product.unwrap_err().to_string().contains("does not tell a, b"));
        let failing = fit_model(&measured, &free(&["name"]), &[1.0], |_| Err(Error::Usage("broken".into())));
        assert_eq!(failing.unwrap_err().to_string(), "broken");
        assert!(fit_model(&measured, &free(&["name"]), &[0.0], |_| unreachable!()).is_err());
        assert!(fit_model(&measured, &[], &[], |_| unreachable!()).is_err());
        // Failures far from the initial values only shorten steps.
        let partly = fit_model(&measured, &free(&["young"]), &[20.0], |values| match values[0] < 40.0 {
            true => Ok(simulated(&measured, |x| press(values[0], 0.0, x))),
            false => Err(Error::Usage("too stiff".into())),
        });
        assert!((partly.unwrap().estimates[0].value - 30.0).abs() < 0.1);
        // The simulation ahead of the best value fails: the difference is taken backwards.
        let edge = fit_model(&measured, &free(&["young"]), &[20.0], |values| match values[0] < 30.2 {
            true => Ok(simulated(&measured, |x| press(values[0], 0.0, x))),
            false => Err(Error::Usage("too stiff".into())),
        });
        let edge = edge.unwrap();
        assert!((edge.estimates[0].value - 30.0).abs() < 0.1, "{edge:?}");
        let few = Measured::of(Abscissa::Indentation, curve(|x| press(30.0, 0.1, x)).points[..8].to_vec()).unwrap();
        let fit =
            fit_model(&few, &free(&["young"]), &[20.0], |values| Ok(simulated(&few, |x| press(values[0], 0.0, x))));
        assert!(matches!(fit.unwrap().verdict, Verdict::FewPoints | Verdict::OtherShape | Verdict::NoValueFits));
    }
}
