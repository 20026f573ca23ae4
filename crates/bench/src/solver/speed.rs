//! Measures time and error for `palpate bench solver`: runs each case (a body with its stiffness and time step, from
//! rest, without contact) with each preconditioner of the linear solver and each solver tolerance. A setting is a
//! preconditioner with a tolerance; a repetition does all steps of the case once with every setting. The error is
//! measured against the reference, the solution of the case in f64 with a direct solver.

use std::time::Instant;

use palpate::internal::prepare::Cache;
use palpate::scene::Preconditioner;
use palpate::{Flags, Options, Result, Scene, Simulation};
use serde::{Deserialize, Serialize};

use super::cases::{self, Case};
use super::reference::{Reference, reference};
use super::{PRECONDITIONERS, Settings};
use crate::median;
use crate::samples::hands;
use crate::suite::nan_of_null;

/// Number of steps that one setting does before the next setting has its turn. The first steps of a turn find the
/// caches cold; with this number of steps, the median is the time of a step that finds them warm.
const TURN: usize = 5;

/// Measurements of a case.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Measured {
    /// Name of the case.
    pub name: String,
    /// The case: body, stiffness, time step and number of steps.
    #[serde(flatten)]
    pub case: Case,
    /// Number of tetrahedra of the body.
    pub tetrahedra: usize,
    /// Number of nodes of the body, including those attached to the rigid core (fixed rigid body inside it).
    pub nodes: usize,
    /// Time that the computation of the reference took, on the machine that did it, s.
    pub reference_seconds: f64,
    /// Largest displacement of a node in the reference, after the last step, m.
    pub largest_displacement: f64,
    /// Measurements of each setting of the solver.
    pub runs: Vec<Run>,
}

/// Measurements of one setting: a preconditioner with a tolerance.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Run {
    /// Name of the preconditioner.
    pub preconditioner: String,
    /// Solver tolerance (relative residual at which the solver stops).
    pub tolerance: f64,
    /// Largest distance of a node from its position in the reference after the last step, divided by the reference's
    /// largest displacement; the largest such value of all repetitions. NaN, which JSON writes as null, if the position
    /// of a node is not finite.
    #[serde(deserialize_with = "nan_of_null")]
    pub error: f64,
    /// Number of solver iterations in each step of the last repetition.
    pub iterations: Vec<u32>,
    /// Number of steps of the last repetition that raised a flag (report of a problem in a step).
    pub flagged: usize,
    /// Names of the flags that the last repetition raised.
    pub flags: Vec<String>,
    /// GPU memory that the simulation allocated, bytes.
    pub bytes_device: u64,
    /// Wall time of each step, us; one list for each repetition.
    pub step_us: Vec<Vec<f64>>,
}

impl Run {
    /// Time of a step, ms: the median, over the repetitions, of the median time of a step in each repetition.
    pub fn ms(&self) -> f64 {
        median(&self.medians_ms())
    }

    /// Spread of the time of a step, ms: the least and the greatest of the repetitions' medians. With fewer than five
    /// repetitions, the steps of all repetitions are dealt into five interleaved subsets, whose medians take the place
    /// of the repetitions' medians (see [`hands`]).
    pub fn range_ms(&self) -> [f64; 2] {
        let hands = hands(&self.step_us);
        let (low, high) = hands.into_iter().fold((f64::INFINITY, 0.0f64), |(a, b), us| (a.min(us), b.max(us)));
        [1e-3 * low, 1e-3 * high]
    }

    /// Median number of solver iterations of a step.
    pub fn median_iterations(&self) -> f64 {
        median(&self.iterations.iter().map(|&n| f64::from(n)).collect::<Vec<_>>())
    }

    /// Whether there is time for one more repetition: whether all repetitions together take at most `seconds` seconds
    /// if the new one takes as long as the earlier ones did on average.
    fn is_worth_another(&self, seconds: f64) -> bool {
        let spent = 1e-6 * self.step_us.iter().flatten().sum::<f64>();
        let done = self.step_us.len() as f64;
        done == 0.0 || spent * (done + 1.0) / done <= seconds
    }

    fn add_step(&mut self, simulation: &mut Simulation) -> Result<Flags> {
        let begun = Instant::now();
        let row = simulation.step()?;
        let time = begun.elapsed().as_secs_f64() * 1e6;
        self.step_us.last_mut().into_iter().for_each(|steps| steps.push(time));
        self.iterations.push(row.iterations);
        self.flagged += usize::from(row.flags != Flags::default());
        Ok(row.flags)
    }

    fn medians_ms(&self) -> Vec<f64> {
        self.step_us.iter().map(|steps| 1e-3 * median(steps)).collect()
    }
}

/// Measures a case with every setting; `watch` is called with a line of text before each piece of the work.
pub fn measure(case: &Case, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Measured> {
    let scene = case.scene()?;
    let body = cases::prepared(&scene)?;
    let layer = cases::layer(&body)?;
    let reference = reference(&scene, &body, case.steps, &Cache::of_user(), watch)?;
    let asked = PRECONDITIONERS.iter().flat_map(|p| settings.tolerances.iter().map(move |tolerance| (p, *tolerance)));
    let mut runs: Vec<(Scene, Run)> = asked
        .map(|(&(preconditioner, kind), tolerance)| {
            (
                asking(&scene, kind, tolerance, settings),
                Run { preconditioner: preconditioner.into(), tolerance, ..Run::default() },
            )
        })
        .collect();
    for repetition in 0..settings.repetitions {
        watch(&format!("{}: run {} of {}", case.name(), repetition + 1, settings.repetitions));
        repeat(&mut runs, case.steps, &reference, settings)?;
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

/// A copy of the scene with this preconditioner and this tolerance, and with the cap on solver iterations that the
/// benchmark's `settings` give.
pub fn asking(scene: &Scene, preconditioner: Preconditioner, tolerance: f64, settings: &Settings) -> Scene {
    let mut scene = scene.clone();
    scene.solver.preconditioner = preconditioner;
    scene.solver.tolerance = Some(tolerance);
    scene.solver.max_iterations = settings.max_iterations;
    scene
}

/// Opens the engine on a scene, and switches off the GPU timestamps of the stages of a step, because taking them costs
/// time.
pub fn open(scene: &Scene, settings: &Settings) -> Result<Simulation> {
    let mut simulation =
        Simulation::open(scene, &Options { device: settings.device.clone(), ..Options::of_program() })?;
    simulation.time_every(0)?;
    Ok(simulation)
}

/// Does one more repetition, a few steps of each setting in turn, so that a change of the machine's speed affects all
/// settings alike. A setting whose time is used up is left out.
fn repeat(runs: &mut [(Scene, Run)], steps: usize, reference: &Reference, settings: &Settings) -> Result<()> {
    let mut under_way = Vec::new();
    for (scene, run) in runs.iter_mut() {
        if run.is_worth_another(settings.seconds_each) {
            run.iterations.clear();
            run.flagged = 0;
            run.step_us.push(Vec::with_capacity(steps));
            under_way.push((open(scene, settings)?, Flags::default(), run));
        }
    }
    for turn in (0..steps).step_by(TURN) {
        for (simulation, flags, run) in &mut under_way {
            for _ in turn..steps.min(turn + TURN) {
                *flags |= run.add_step(simulation)?;
            }
        }
    }
    for (simulation, flags, run) in under_way {
        run.flags = flags.names().map(Into::into).collect();
        run.bytes_device = simulation.context().bytes_allocated();
        if let Some((displacement, _)) = simulation.nodes(0)? {
            let error = reference.error(&displacement);
            run.error = if error > run.error || error.is_nan() { error } else { run.error };
        }
    }
    Ok(())
}
