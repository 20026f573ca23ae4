//! Runs the cases of the stability matrix (many stiff and extreme simulations, each judged by invariants), several in
//! parallel. A case is a small simulation, which runs on one thread; a cell of the matrix has the cases with one value
//! of a varied quantity, the axis.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use glam::DVec3;
use palpate::internal::prepare::Shape;
use palpate::{Context, Error, Flags, Options, Result, Simulation, Threads};

use super::axes::{self, Axis, Extent};
use super::cases::{Case, Start};
use super::invariants::{self, Promise, Verdict};
use super::trace::{Observer, Sample};
use super::{AxisResult, CellResult, Judged, Results, Settings, Traced, modes};
use crate::meshes::MeshFolder;

/// A case whose block was let go promises that the block is back in its rest shape only if the bound on the kinetic
/// energy at the end, which includes a safety factor of ten, is below this share of the block's greatest energy. Then
/// at most a twentieth of the displacement is left.
const SHAPED: f64 = 1e-2;
/// Greatest number of iterations of a tight solver.
const TIGHT_ITERATIONS: u32 = 2000;
/// A long case keeps about this number of evenly spaced steps as its trace (measurements for the report).
const TRACED: usize = 200;
/// Greatest number of simulations in parallel; each opens a Vulkan device of its own.
const MOST_WORKERS: usize = 8;

/// Runs the matrix; `watch` is called with the name and verdict of each case that has ended.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let begun = Instant::now();
    // The device is opened before the workers start, since the number of the driver's threads must be chosen while the
    // program has no other threads.
    let context = Context::open(&options(settings))?;
    let (device, driver) = (context.device_name().to_string(), context.driver().to_string());
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    let folder = MeshFolder::new()?;
    let extent = Extent { is_quick: settings.is_quick, is_soak: settings.is_soak, folder: &folder };
    let wanted = |name: &&&str| settings.only.is_empty() || settings.only.iter().any(|only| only == **name);
    let axes: Vec<Axis> = axes::NAMES
        .iter()
        .filter(wanted)
        .filter_map(|name| axes::axis(name, extent).transpose())
        .collect::<Result<_>>()?;
    let cases: Vec<(String, &Case)> = axes
        .iter()
        .flat_map(|axis| axis.cells.iter().map(move |cell| (axis, cell)))
        .flat_map(|(axis, cell)| {
            cell.cases.iter().map(move |case| (format!("{} {}, {}", axis.name, cell.label, case.scenario), case))
        })
        .collect();
    let judged = all(&cases, settings, threads.min(MOST_WORKERS), watch)?;
    let mut judged = judged.into_iter();
    let axes = axes
        .iter()
        .map(|axis| AxisResult {
            name: axis.name.into(),
            title: axis.title.into(),
            is_listed: axis.is_listed,
            cells: axis.cells.iter().map(|cell| cell_result(cell, &mut judged)).collect(),
        })
        .collect();
    Ok(Results {
        schema: super::SCHEMA,
        version: env!("CARGO_PKG_VERSION").into(),
        commit: env!("PALPATE_COMMIT").into(),
        device,
        driver,
        threads,
        settings: settings.clone(),
        axes,
        seconds: begun.elapsed().as_secs_f64(),
    })
}

fn cell_result(cell: &axes::Cell, judged: &mut impl Iterator<Item = Judged>) -> CellResult {
    let cases: Vec<Judged> = judged.take(cell.cases.len()).collect();
    let verdict = cases.iter().map(|case| case.verdict).max().unwrap_or(Verdict::Pass);
    CellResult { label: cell.label.clone(), is_core: cell.is_core, verdict, cases }
}

/// Runs all cases on `workers` threads; the results are in the order of the cases.
fn all(
    cases: &[(String, &Case)],
    settings: &Settings,
    workers: usize,
    watch: &mut dyn FnMut(&str),
) -> Result<Vec<Judged>> {
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::channel();
    let mut judged: Vec<Option<Judged>> = vec![None; cases.len()];
    std::thread::scope(|scope| {
        for _ in 0..workers.min(cases.len()) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                let take = || next.fetch_add(1, Ordering::Relaxed);
                let mut at = take();
                while let Some((_, case)) = cases.get(at) {
                    // Sending fails if the receiver has stopped because of the error of another case.
                    if sender.send((at, judge(case, settings))).is_err() {
                        break;
                    }
                    at = take();
                }
            });
        }
        drop(sender);
        for (at, result) in receiver {
            let result = result.inspect_err(|_| next.store(cases.len(), Ordering::Relaxed))?;
            watch(&format!("{}: {}", cases[at].0, result.in_words()));
            judged[at] = Some(result);
        }
        Ok(())
    })?;
    Ok(judged.into_iter().flatten().collect())
}

fn options(settings: &Settings) -> Options {
    Options {
        device: settings.device.clone(),
        threads: Some(Threads::Auto),
        replaced: settings.replaced.clone(),
        ..Options::of_program()
    }
}

/// Runs a case and judges it. A scene that the engine refuses gets the verdict `Refused`. Errors: the GPU device fails.
fn judge(case: &Case, settings: &Settings) -> Result<Judged> {
    let begun = Instant::now();
    let scene = case.setup.scene(case.scenario);
    let mut simulation = match Simulation::open(&scene, &options(settings)) {
        Ok(simulation) => simulation,
        Err(error @ (Error::Key { .. } | Error::Input { .. })) => {
            let refusal = Some(error.to_string());
            return Ok(Judged { verdict: Verdict::Refused, refusal, ..judged(case, &[], &case.promise, begun) });
        }
        Err(error) => return Err(error),
    };
    simulation.time_every(0)?;
    begin(&mut simulation, case)?;
    let mut observer = Observer::new(&simulation, &scene, case.setup.edge)?;
    let decay = modes::slowest_decay(observer.body(), case.setup.dt)?;
    let mut samples = vec![observer.at_start()];
    for _ in 0..case.steps {
        let sample = observer.step(&mut simulation)?;
        samples.push(sample);
        if !sample.is_finite {
            break;
        }
    }
    let promise = Promise { peak: tight_peak(case, settings, &samples)?, ..promise(case, decay, &samples) };
    Ok(judged(case, &samples, &promise, begun))
}

/// Greatest contact force on the tool, N, in a case with a preset, whose solver is loose, if the solver were tight.
/// Where even then a step does not converge, only the steps before it count; NaN if the peak of `samples`, those of the
/// loose solver, is not among these steps, so that there is nothing to compare with. `None`: there is no preset.
fn tight_peak(case: &Case, settings: &Settings, samples: &[Sample]) -> Result<Option<f64>> {
    if case.setup.preset.is_none() {
        return Ok(None);
    }
    let mut scene = case.setup.scene(case.scenario);
    (scene.solver.tolerance, scene.solver.max_iterations) = (Some(invariants::TIGHT), TIGHT_ITERATIONS);
    let mut simulation = Simulation::open(&scene, &options(settings))?;
    begin(&mut simulation, case)?;
    let peak =
        samples.iter().enumerate().max_by(|(_, a), (_, b)| a.force.total_cmp(&b.force)).map_or(0, |(step, _)| step);
    let mut most = 0.0f64;
    for step in 1..=case.steps {
        let report = simulation.step()?;
        if report.flags.contains(Flags::NOT_CONVERGED) {
            return Ok(Some(if step > peak { most } else { f64::NAN }));
        }
        most = most.max(report.tool.map_or(0.0, |tool| tool.force.length()));
    }
    Ok(Some(most))
}

/// The case's promise (invariants that it must keep in addition to those of every step), with a bound on the kinetic
/// energy at the end: ten times what the slowest mode keeps, since the motion begins in several modes. If that bound is
/// too high to show that the block is at rest, or in its rest shape, the case does not promise it. `decay` is the
/// factor by which the velocity of the slowest mode changes in a step.
fn promise(case: &Case, decay: f64, samples: &[Sample]) -> Promise {
    let Some(settling) = case.settling else { return case.promise };
    let since_pressed = || samples.iter().rev().take_while(|sample| sample.pressed == 0.0).count();
    let steps = settling.steps.unwrap_or_else(since_pressed);
    // The last steps, over which the end is judged, do not count as time to come to rest.
    let due = steps.saturating_sub(samples.len() - invariants::end_of(samples));
    let left = 10.0 * decay.max(settling.other).powf(2.0 * due as f64);
    let shape = case.promise.shape.filter(|_| left < SHAPED);
    Promise { rest: Some(left).filter(|left| *left < 1.0), shape, ..case.promise }
}

fn judged(case: &Case, samples: &[Sample], promise: &Promise, begun: Instant) -> Judged {
    let findings = invariants::judge(samples, promise);
    let verdict = invariants::verdict(samples, &findings);
    Judged {
        scenario: case.scenario.into(),
        verdict,
        steps: samples.len().saturating_sub(1),
        flags: samples.iter().fold(0, |all, sample| all | sample.flags.0),
        flagged: samples.iter().filter(|sample| sample.flags.0 != 0).count(),
        first_flagged: samples.iter().position(|sample| sample.flags.0 != 0),
        inverted: samples.iter().map(|sample| sample.inverted).max().unwrap_or(0),
        findings,
        refusal: None,
        trace: if verdict == Verdict::Pass { Vec::new() } else { traced(samples) },
        seconds: begun.elapsed().as_secs_f64(),
    }
}

/// The trace of a case: every step of a short case, or about [`TRACED`] evenly spaced steps of a longer one; the last
/// step is always included.
fn traced(samples: &[Sample]) -> Vec<Traced> {
    let every = samples.len().div_ceil(TRACED);
    let is_kept = |step: &usize| step.is_multiple_of(every) || *step + 1 == samples.len();
    let of = |(step, sample): (usize, &Sample)| Traced {
        step,
        energy: sample.energy,
        supplied: sample.supplied,
        force: sample.force,
        residual: sample.residual,
        balance: sample.balance,
        inverted: sample.inverted,
        flags: sample.flags.0,
    };
    samples.iter().enumerate().filter(|(step, _)| is_kept(step)).map(of).collect()
}

/// Sets the nodes to the case's initial state.
fn begin(simulation: &mut Simulation, case: &Case) -> Result<()> {
    let Shape::Soft { layer, .. } = &simulation.bodies()[0].shape else { return Ok(()) };
    let rest = layer.nodes.clone();
    let middle = DVec3::splat(0.5 * case.setup.edge);
    let (displacements, velocities): (Vec<DVec3>, Vec<DVec3>) = match case.start {
        Start::Rest => return Ok(()),
        Start::Stretched(factor) => rest.iter().map(|x| (DVec3::Y * (factor - 1.0) * x.y, DVec3::ZERO)).unzip(),
        Start::Spinning(speed) => {
            let spin = speed * DVec3::new(2.0, 3.0, 6.0) / 7.0;
            rest.iter().map(|x| (DVec3::ZERO, spin.cross(*x - middle))).unzip()
        }
    };
    simulation.place_nodes(0, &displacements, &velocities)
}
