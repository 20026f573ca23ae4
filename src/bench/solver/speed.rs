//! Time of a step against the error that it leaves: every case with each preconditioner and tolerance.

use std::time::Instant;

use serde::Serialize;

use super::cases::{self, Case};
use super::reference::reference;
use super::{PRECONDITIONERS, Settings};
use crate::Result;
use crate::bench::median;
use crate::gpu::Options;
use crate::prepare::Cache;
use crate::report::Flags;
use crate::scene::{Preconditioner, Scene};
use crate::step::Simulation;

/// A case and what was found.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// Its name.
    pub name: String,
    /// What it is.
    #[serde(flatten)]
    pub case: Case,
    /// Of the body.
    pub tetrahedra: usize,
    /// Of the body, bound ones included.
    pub nodes: usize,
    /// What the reference took on the machine that found it, s.
    pub reference_seconds: f64,
    /// Largest displacement after the last step, by the reference, m.
    pub largest_displacement: f64,
    /// What was measured.
    pub runs: Vec<Run>,
}

/// A preconditioner and a tolerance.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Run {
    /// Name of the preconditioner.
    pub preconditioner: &'static str,
    /// Residual to stop at.
    pub tolerance: f64,
    /// Largest distance of a node from the reference after the last step, over the largest displacement; the worst of all
    /// repetitions; NaN, in JSON null, where the state is not finite.
    pub error: f64,
    /// Of each step.
    pub iterations: Vec<u32>,
    /// Steps that raised a flag.
    pub flagged: usize,
    /// Names of the flags.
    pub flags: Vec<&'static str>,
    /// Bytes on the device.
    pub bytes_device: u64,
    /// Microseconds, a step each, for each repetition.
    pub step_us: Vec<Vec<f64>>,
}

impl Run {
    /// Milliseconds of a step: the median over the steps of a repetition, the median of those.
    pub fn ms(&self) -> f64 {
        median(&self.medians_ms())
    }

    /// The same of the fastest repetition.
    pub fn best_ms(&self) -> f64 {
        self.medians_ms().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Median of the iterations of a step.
    pub fn median_iterations(&self) -> f64 {
        median(&self.iterations.iter().map(|&n| f64::from(n)).collect::<Vec<_>>())
    }

    fn medians_ms(&self) -> Vec<f64> {
        self.step_us.iter().map(|steps| 1e-3 * median(steps)).collect()
    }
}

/// Measures every case of the settings, and tells `watch` of it.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Measured>> {
    let tell = |case: &Case| measure_one(case, settings, &mut |what| watch(&format!("{}: {what}", case.name())));
    settings.cases.iter().map(tell).collect()
}

fn measure_one(case: &Case, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Measured> {
    let scene = case.scene()?;
    let body = cases::prepared(&scene)?;
    let layer = cases::layer(&body)?;
    let reference = reference(&scene, &body, case.steps, &Cache::of_user(), watch)?;
    let asked = PRECONDITIONERS.iter().flat_map(|p| settings.tolerances.iter().map(move |tolerance| (p, *tolerance)));
    let mut runs: Vec<(Scene, Run)> = asked
        .map(|(&(preconditioner, kind), tolerance)| {
            (asking(&scene, kind, tolerance, settings), Run { preconditioner, tolerance, ..Run::default() })
        })
        .collect();
    let count = runs.len();
    for repetition in 0..settings.repetitions {
        // Each time another one goes first, so that what changes on the machine meanwhile favours none.
        for k in 0..count {
            let (scene, run) = &mut runs[(k + repetition) % count];
            let spent: f64 = 1e-6 * run.step_us.iter().flatten().sum::<f64>();
            if repetition > 0 && spent * (1.0 + 1.0 / repetition as f64) > settings.seconds_each {
                continue;
            }
            watch(&format!("{} to {:.0e}, run {}", run.preconditioner, run.tolerance, repetition + 1));
            let mut simulation = open(scene, settings)?;
            add(run, &mut simulation, case.steps)?;
            if let Some((displacement, _)) = simulation.nodes(0)? {
                let error = reference.error(&displacement);
                run.error = if error > run.error || error.is_nan() { error } else { run.error };
            }
        }
    }
    Ok(Measured {
        name: case.name(),
        case: *case,
        tetrahedra: layer.tetrahedra.len(),
        nodes: layer.nodes.len(),
        reference_seconds: reference.seconds,
        largest_displacement: reference.largest(),
        runs: runs.into_iter().map(|(_, run)| run).collect(),
    })
}

/// The scene with a solver of its own.
pub fn asking(scene: &Scene, preconditioner: Preconditioner, tolerance: f64, settings: &Settings) -> Scene {
    let mut scene = scene.clone();
    scene.solver.preconditioner = preconditioner;
    scene.solver.tolerance = tolerance;
    scene.solver.max_iterations = settings.max_iterations;
    scene
}

/// The engine on a scene; no step is timed by stage, which would take time.
pub fn open(scene: &Scene, settings: &Settings) -> Result<Simulation> {
    let mut simulation = Simulation::new(scene, &Options { device: settings.device.clone(), validation: false }, None)?;
    simulation.time_every(0);
    Ok(simulation)
}

fn add(run: &mut Run, simulation: &mut Simulation, steps: usize) -> Result<()> {
    let (mut flags, mut times) = (Flags::default(), Vec::with_capacity(steps));
    run.iterations.clear();
    run.flagged = 0;
    for _ in 0..steps {
        let begun = Instant::now();
        let row = simulation.step()?;
        times.push(begun.elapsed().as_secs_f64() * 1e6);
        run.iterations.push(row.iterations);
        run.flagged += usize::from(row.flags != Flags::default());
        flags |= row.flags;
    }
    run.flags = flags.names().collect();
    run.bytes_device = simulation.context().bytes_allocated();
    run.step_us.push(times);
    Ok(())
}
