//! Blocks from small to large: time of an iteration and of a step, and memory.

use std::time::Instant;

use palpate::scene::Preconditioner;
use palpate::{Flags, Result, Scene, Simulation};
use serde::{Deserialize, Serialize};

use super::cases::{self, Mesh};
use super::speed::{asking, open};
use super::{PRECONDITIONERS, Settings, YOUNG};
use crate::median;

/// Iterations of the two steps whose difference is taken.
const ITERATIONS: [u32; 2] = [32, 8];
/// No step gets there in so few iterations.
const NEVER: f64 = 1e-30;
/// Stiff, so that no step is done after so few iterations, Pa.
const STIFF: f64 = 2e6;
/// Time step, s.
const DT: f64 = 0.001;
/// Steps before those that are measured, unless they take too long.
const WARM_UP: usize = 2;

/// A block's times.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Size {
    /// Of the block.
    pub tetrahedra: usize,
    /// Of the block.
    pub nodes: usize,
    /// Iterations of each preconditioner.
    pub iterations: Vec<Iteration>,
    /// Steps of each material.
    pub steps: Vec<Steps>,
}

/// What an iteration costs.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Iteration {
    /// Name of the preconditioner.
    pub preconditioner: String,
    /// Bytes on the device.
    pub bytes_device: u64,
    /// Microseconds of steps of the first number of `iterations`.
    pub long_us: Vec<f64>,
    /// Microseconds of steps of the second number, in turn with the others.
    pub short_us: Vec<f64>,
    /// Iterations that those steps did.
    pub iterations: [u32; 2],
}

/// Steps to the usual tolerance with the usual preconditioner.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Steps {
    /// Young's modulus, Pa.
    pub young: f64,
    /// Of each step.
    pub iterations: Vec<u32>,
    /// Steps that raised a flag.
    pub flagged: usize,
    /// Microseconds, a step each.
    pub step_us: Vec<f64>,
}

impl Iteration {
    /// Milliseconds of an iteration: the difference of the medians over that of the iterations; NaN where that is none.
    pub fn ms(&self) -> f64 {
        let [long, short] = [&self.long_us, &self.short_us].map(|times| 1e-3 * median(times));
        (long - short) / (f64::from(self.iterations[0]) - f64::from(self.iterations[1]))
    }
}

impl Steps {
    /// Median, ms.
    pub fn ms(&self) -> f64 {
        1e-3 * median(&self.step_us)
    }

    /// Median.
    pub fn median_iterations(&self) -> f64 {
        median(&self.iterations.iter().map(|&n| f64::from(n)).collect::<Vec<_>>())
    }
}

/// Measures every size of the settings.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Size>> {
    let mut sizes = Vec::new();
    let mut pairs = Vec::new();
    for &cells in &settings.scaling {
        watch(&format!("scaling: a block of {cells} cells an edge"));
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
        // All in turn, so that what changes on the machine meanwhile favours no size.
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
    /// A step of each; another before it finds the caches cold and is not measured.
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
    let tolerance = scene.solver.tolerance;
    let mut simulation = open(&asking(&scene, Preconditioner::Auto, tolerance, settings), settings)?;
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
