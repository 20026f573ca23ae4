//! Lists what is recorded for a step, pass by pass and array by array, for `palpate run --explain`. The list is read
//! from the recordings (command buffers) themselves.

use super::Simulation;
use crate::gpu::{ArrayUse, Recording, shader_names};
use crate::plan::{Array, Explanation, KernelUse, StageUse, stage_of, why_not};
use crate::stages::depth::Path;

/// Folders whose shaders are no part of the step: these shaders are for tests or for drawing.
const OTHER_SHADERS: [&str; 3] = ["test/", "draw/", "view/"];

impl Simulation {
    /// Every stage with its passes and arrays, for a step of `iterations` solver iterations in a single solve.
    #[doc(hidden)]
    pub fn explain(&self, iterations: u32) -> Explanation {
        let features = self.plan.features(&self.scene, &self.model, &self.bodies, self.timed_every);
        let mut stages: Vec<StageUse> = self.plan.entries.iter().map(StageUse::of).collect();
        for (recording, times) in self.parts(iterations) {
            for pass in recording.all_passes() {
                let Some(stage) = stages.iter_mut().find(|stage| stage.stage == pass.stage) else { continue };
                stage.count(pass, times);
            }
        }
        self.add_left_out(&mut stages);
        for array in self.arrays() {
            if let Some(stage) = stages.iter_mut().find(|stage| stage.stage == array.stage) {
                stage.arrays.push(Array { name: array.name.clone(), bytes: array.bytes, on_device: array.on_device });
            }
        }
        stages.iter_mut().for_each(StageUse::close);
        Explanation {
            scene: self.scene.name(),
            device: self.context.device_name().into(),
            driver: self.context.driver().into(),
            preset: self.scene.preset.clone(),
            iterations,
            passes: stages.iter().map(|stage| stage.passes).sum(),
            dependent_passes: stages.iter().map(|stage| stage.dependent).sum(),
            bytes_device: self.context.bytes_allocated(),
            stages,
            features,
        }
    }

    /// The recordings of a step of `iterations` solver iterations, each with the number of times that its passes run in
    /// the step (not always a whole number).
    pub(super) fn parts(&self, iterations: u32) -> Vec<(&Recording, f64)> {
        let (length, iterate) = self.plain.iterate.shortest();
        let newton = f64::from(self.scene.step.newton);
        let share = f64::from(iterations) / f64::from(length);
        let mut parts = vec![(&self.plain.begin, 1.0), (iterate, share)];
        // Several Newton iterations are followed by a check, which needs no solver iterations.
        let ends = newton + if newton > 1.0 { 1.0 } else { 0.0 };
        parts.push((&self.plain.end, ends));
        parts.extend(self.plain.gap.iter().filter(|_| self.is_in_haptic_loop()).map(|gap| (gap, 1.0)));
        parts.extend(self.plain.newton.iter().map(|newton| (newton, ends - 1.0)));
        parts
    }

    /// The arrays of all recordings of the step, each array once.
    fn arrays(&self) -> Vec<ArrayUse> {
        let mut arrays: Vec<ArrayUse> = Vec::new();
        let parts = self.parts(1).into_iter().map(|(recording, _)| recording);
        for recording in parts.chain(&self.plain.gap).chain([&self.plain.stop]) {
            for array in recording.arrays() {
                if arrays.iter().all(|known| known.id != array.id) {
                    arrays.push(array.clone());
                }
            }
        }
        arrays
    }

    /// Adds to each stage the kernels of the step that the stage did not record, with the reason.
    fn add_left_out(&self, stages: &mut [StageUse]) {
        let graphics = self.path == Some(Path::Graphics);
        for kernel in shader_names().filter(|name| !OTHER_SHADERS.iter().any(|folder| name.starts_with(folder))) {
            let Some(stage) = stages.iter_mut().find(|stage| stage.stage == stage_of(kernel)) else { continue };
            // A draw has two shaders, which are listed with a comma between them.
            if stage.kernels.iter().any(|known| known.kernel.split(", ").any(|name| name == kernel)) {
                continue;
            }
            let reason = match stage.recorded {
                true => why_not(kernel, &self.model, graphics).unwrap_or_default().into(),
                false => stage.reason.clone(),
            };
            stage.kernels.push(KernelUse { kernel: kernel.into(), reason, ..KernelUse::default() });
        }
    }
}
