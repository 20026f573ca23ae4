//! Fits of scenes to measured curves.

use std::path::PathBuf;
use std::sync::PoisonError;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use palpate_fit::{Abscissa, Free, Measured, Verdict};
use pyo3::prelude::*;

use crate::context::{OPENING, options};
use crate::failure::raise;
use crate::scene::plain;

/// A fitted value: key, initial value, value, standard error and 95 % interval.
type Estimate = (String, f64, f64, f64, [f64; 2]);

/// The estimates, their correlation, scatter, verdict, forces, extrapolated points, number of simulations, and flags.
type Found<'py> = (Vec<Estimate>, Vec<Vec<f64>>, f64, &'static str, Bound<'py, PyArray1<f64>>, usize, u32, u32);

/// Fits values of a scene's tables to a curve over time (s) or indentation (m).
#[pyfunction]
#[pyo3(signature = (file, tables, is_over_time, x, force, free, device))]
#[expect(clippy::too_many_arguments, reason = "the signature is that of the function in Python")]
pub fn fit<'py>(
    py: Python<'py>,
    file: PathBuf,
    tables: &Bound<'_, PyAny>,
    is_over_time: bool,
    x: PyReadonlyArray1<'_, f64>,
    force: PyReadonlyArray1<'_, f64>,
    free: Vec<(String, Option<(f64, f64)>)>,
    device: Option<String>,
) -> PyResult<Found<'py>> {
    let tables: toml::Table = plain(tables)?;
    let over = if is_over_time { Abscissa::Time } else { Abscissa::Indentation };
    let points = x.as_array().iter().copied().zip(force.as_array().iter().copied()).collect();
    let free: Vec<Free> = free.into_iter().map(|(key, bounds)| Free { key, bounds }).collect();
    let options = options(device, Some("auto"), true, None)?;
    let found = py.detach(|| {
        let measured = Measured::of(over, points)?;
        let context = {
            let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
            palpate::Context::open(&options)?
        };
        palpate_fit::fit(file, &tables, &measured, &free, &context)
    });
    let found = found.map_err(raise)?;
    let verdict = match found.verdict {
        Verdict::Fits => "fits",
        Verdict::OtherShape => "other shape",
        Verdict::NoValueFits => "no value fits",
        Verdict::FewPoints => "few points",
        Verdict::AtBound => "at bound",
        Verdict::NotConverged => "not converged",
    };
    let estimates = found.estimates.into_iter().map(|e| (e.key, e.initial, e.value, e.standard_error, e.interval));
    let forces = found.forces.into_pyarray(py);
    let counts = (found.extrapolated, found.simulations);
    Ok((estimates.collect(), found.correlation, found.scatter, verdict, forces, counts.0, counts.1, found.flags.0))
}
