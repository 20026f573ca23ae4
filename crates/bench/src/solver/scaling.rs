//! Part `scaling` of `palpate bench solver`: the time of a solver iteration, the time of a step and the GPU memory, for
//! soft blocks with meshes from small to large.

use std::time::Instant;

use palpate::scene::Preconditioner;
use palpate::{Flags, Result, Scene, Simulation};
use serde::{Deserialize, Serialize};

use super::cases::{self, Mesh};
use super::speed::{asking, open};
use super::{PRECONDITIONERS, Settings, YOUNG};
use crate::median;

/// Caps on the solver iterations of a step: first of long steps, then of short steps. The difference of the times of a
/// long and a short step, divided by the difference of these numbers, is the time of an iteration.
const ITERATIONS: [u32; 2] = [32, 8];
/// A tolerance that no step reaches within either of the caps [`ITERATIONS`].
const NEVER: f64 = 1e-30;
/// Young's modulus of the blocks whose iterations are timed, Pa; they are so stiff that no step converges within
/// either of the caps [`ITERATIONS`].
const STIFF: f64 = 2e6;
/// Time step, s.
const DT: f64 = 0.001;
/// Relative residual at which the solver of a whole step stops.
const STEP_TOLERANCE: f64 = 1e-5;
/// Number of steps before the measured ones. If these steps alone exceed the time budget (`seconds_each`), the step
/// that exceeds it is measured.
const WARM_UP: usize = 2;

/// Measurements of a block of one size.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Size {
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Cost of an iteration with each preconditioner.
    pub iterations: Vec<Iteration>,
    /// Cost of whole steps for each Young's modulus.
    pub steps: Vec<Steps>,
}

/// Cost of a solver iteration.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Iteration {
    /// Name of the preconditioner.
    pub preconditioner: String,
    /// GPU memory of a simulation with this preconditioner, bytes.
    pub bytes_device: u64,
    /// Times of long steps, those with the greater cap on the solver iterations, us.
    pub long_us: Vec<f64>,
    /// Times of short steps, those with the smaller cap on the solver iterations, us; long and short steps alternate.
    pub short_us: Vec<f64>,
    /// Number of solver iterations that a long step did, and number that a short step did.
    pub iterations: [u32; 2],
}

/// Cost of steps with the default tolerance and preconditioner.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Steps {
    /// Young's modulus, Pa.
    pub young: f64,
    /// Solver iterations of each step.
    pub iterations: Vec<u32>,
    /// Number of steps that raised a flag (report of a problem in a step).
    pub flagged: usize,
    /// Wall time of each step, us.
    pub step_us: Vec<f64>,
}

impl Iteration {
    /// Time of an iteration, ms: the difference of the median times of long and of short steps, divided by the
    /// difference of their numbers of iterations. NaN: both differences are zero.
    pub fn ms(&self) -> f64 {
        let [long, short] = [&self.long_us, &self.short_us].map(|times| 1e-3 * median(times));
        (long - short) / (f64::from(self.iterations[0]) - f64::from(self.iterations[1]))
    }
}

impl Steps {
    /// Median time of a step, ms.
    pub fn ms(&self) -> f64 {
        1e-3 * median(&self.step_us)
    }

    /// Median number of solver iterations of a step.
    pub fn median_iterations(&self) -> f64 {
        median(&self.iterations.iter().map(|&n| f64::from(n)).collect::<Vec<_>>())
    }
}

/// Measures blocks of all sizes.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Size>> {
    let mut sizes = Vec::new();
    let mut pairs = Vec::new();
    for &cells in &settings.scaling {
        watch(&format!("scaling: a block of {cells} cells along an edge"));
        let scene = Mesh::Block(cells).scene(STIFF, DT)?;
        let body = cases::prepared(&scene)?;
        let layer = cases::layer(&body)?;
        let mut size = Size { tetrahedra: layer.tetrahedra.len(), nodes: layer.nodes.len(), ..Size::default() };
        for &(preconditioner, kind) in PRECONDITIONERS {
            let pair = pair_of(&asking(&scene, kind, NEVER, settings), settings)?;
            let bytes_device = pair[0].context().bytes_allocated();
            size.iterations.push(Iteration {
                preconditioner: preconditioner.into(),
                bytes_device,
                ..Iteration::default()
            });
            pairs.push(pair);
        }
        sizes.push(size);
    }
    for step in 1..=settings.scaling_steps {
        watch(&format!("scaling: iterations, run {step} of {}", settings.scaling_steps));
        // All blocks are timed in turn, so that a change of the machine's speed favours no block.
        let all = sizes.iter_mut().flat_map(|size| &mut size.iterations);
        for (iteration, pair) in all.zip(&mut pairs) {
            iteration.add_steps(pair)?;
        }
    }
    drop(pairs);
    for (size, &cells) in sizes.iter_mut().zip(&settings.scaling) {
        for young in YOUNG {
            watch(&format!("scaling: {} tetrahedra, steps at {:.0} kPa", size.tetrahedra, 1e-3 * young));
            size.steps.push(steps(Mesh::Block(cells), young, settings)?);
        }
    }
    Ok(sizes)
}

fn pair_of(scene: &Scene, settings: &Settings) -> Result<[Simulation; 2]> {
    let limited = |iterations: u32| {
        let mut scene = scene.clone();
        scene.solver.max_iterations = iterations;
        open(&scene, settings)
    };
    Ok([limited(ITERATIONS[0])?, limited(ITERATIONS[1])?])
}

impl Iteration {
    /// Times a step of each of the two simulations. Each simulation first does a step that finds caches cold and is not
    /// counted.
    fn add_steps(&mut self, pair: &mut [Simulation; 2]) -> Result<()> {
        let times = [&mut self.long_us, &mut self.short_us];
        for ((simulation, us), iterations) in pair.iter_mut().zip(times).zip(&mut self.iterations) {
            simulation.step()?;
            let begun = Instant::now();
            *iterations = simulation.step()?.iterations;
            us.push(begun.elapsed().as_secs_f64() * 1e6);
        }
        Ok(())
    }
}

fn steps(mesh: Mesh, young: f64, settings: &Settings) -> Result<Steps> {
    let scene = mesh.scene(young, DT)?;
    let mut simulation = open(&asking(&scene, Preconditioner::Auto, STEP_TOLERANCE, settings), settings)?;
    let mut steps = Steps { young, ..Steps::default() };
    let all = Instant::now();
    for step in 0..WARM_UP + settings.scaling_steps {
        let begun = Instant::now();
        let row = simulation.step()?;
        let is_late = all.elapsed().as_secs_f64() > settings.seconds_each;
        if step >= WARM_UP || is_late {
            steps.step_us.push(begun.elapsed().as_secs_f64() * 1e6);
            steps.iterations.push(row.iterations);
            steps.flagged += usize::from(row.flags != Flags::default());
        }
        if is_late {
            break;
        }
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_iteration_is_the_difference_of_two_steps() {
        let (long_us, short_us) = (vec![5_000.0, 9_000.0, 5_000.0], vec![1_000.0, 2_000.0, 3_000.0]);
        let iteration = Iteration { long_us, short_us, iterations: [32, 8], ..Iteration::default() };
        assert_eq!(iteration.ms(), 0.125);
    }
}
