//! What `palpate run --explain` prints, as a table or as JSON: the stages (parts) of a simulation step with their
//! passes and arrays, and the features that the scene uses. A pass is one dispatch, draw, fill or copy on the GPU. A
//! stage or kernel is *recorded* if its commands are in the command buffers that every step submits; otherwise it is
//! left out.

use std::fmt;

use serde::Serialize;

use super::Feature;
use crate::gpu::Pass;
use crate::scene::preset::Chosen;
use crate::stages::StageNeed;

/// What one step does, and what it leaves out and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explanation {
    /// Name of the scene.
    pub scene: String,
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the device's driver.
    pub driver: String,
    /// The preset (a named set of settings) that the scene names, if any.
    pub preset: Option<Chosen>,
    /// Number of iterations of the linear solver in the step whose passes are counted.
    pub iterations: u32,
    /// Number of passes in the step.
    pub passes: u32,
    /// Number of passes in the step that wait for an earlier pass.
    pub dependent_passes: u32,
    /// GPU memory that was allocated for arrays, bytes; the driver may need more for an array than the array's size.
    pub bytes_device: u64,
    /// All stages in the order of the step.
    pub stages: Vec<StageUse>,
    /// All features, used or not.
    pub features: Vec<Feature>,
}

/// A stage, its passes and its arrays.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StageUse {
    /// Name of the stage.
    pub stage: String,
    /// Whether the stage is recorded, so that steps run it.
    pub recorded: bool,
    /// Why the stage is recorded, or why not.
    pub reason: String,
    /// Number of passes in the step.
    pub passes: u32,
    /// Number of passes that wait for an earlier pass.
    pub dependent: u32,
    /// GPU memory of the arrays that this stage is the first to use, bytes.
    pub bytes_device: u64,
    /// Kernels, fills and copies of the stage; the recorded ones come first.
    pub kernels: Vec<KernelUse>,
    /// Arrays that this stage is the first to use.
    pub arrays: Vec<Array>,
}

/// A kernel, a fill or a copy, and how often a step runs it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct KernelUse {
    /// Name of the kernel (for a draw its two shaders, with a comma between them); for a fill or a copy, the word
    /// "fill" or "copy" and the name of the array that is written.
    pub kernel: String,
    /// Whether the kernel, fill or copy is recorded.
    pub recorded: bool,
    /// Number of passes in a step. For a kernel that runs only in Newton iterations after the first, it is 0 in
    /// a step of one Newton iteration.
    pub passes: f64,
    /// Number of passes that wait for an earlier pass.
    pub dependent: f64,
    /// Why the kernel is left out; empty where it is recorded.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub reason: String,
}

/// An array of the step.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Array {
    /// Name of the array.
    pub name: String,
    /// Size that was asked for, bytes.
    pub bytes: u64,
    /// Whether the array is in GPU memory, rather than in memory that is mapped for the CPU.
    pub on_device: bool,
}

impl StageUse {
    /// A stage of the plan, still without passes and arrays.
    pub(crate) fn of(entry: &StageNeed) -> StageUse {
        let StageNeed { stage, recorded, reason } = entry;
        StageUse { stage: stage.to_string(), recorded: *recorded, reason: reason.clone(), ..StageUse::default() }
    }

    /// Adds a pass, which a step runs `times` times.
    pub(crate) fn count(&mut self, pass: &Pass, times: f64) {
        let at = self.kernels.iter().position(|known| known.kernel == pass.what).unwrap_or_else(|| {
            self.kernels.push(KernelUse { kernel: pass.what.clone(), recorded: true, ..KernelUse::default() });
            self.kernels.len() - 1
        });
        self.kernels[at].passes += times;
        self.kernels[at].dependent += if pass.waits { times } else { 0.0 };
    }

    /// Sums passes and bytes, once all passes and arrays have been added.
    pub(crate) fn close(&mut self) {
        let sum = |of: fn(&KernelUse) -> f64| self.kernels.iter().map(of).sum::<f64>().round() as u32;
        (self.passes, self.dependent) = (sum(|kernel| kernel.passes), sum(|kernel| kernel.dependent));
        self.bytes_device = self.arrays.iter().filter(|array| array.on_device).map(|array| array.bytes).sum();
    }
}

/// Formats a number of bytes with a unit; 0 becomes `-`.
fn amount(bytes: u64) -> String {
    match bytes {
        0 => "-".into(),
        1..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", 1e-3 * bytes as f64),
        _ => format!("{:.1} MB", 1e-6 * bytes as f64),
    }
}

/// Formats a number of passes, rounded to a whole number; 0 becomes `-`. The number is a fraction if some iterations of
/// the solver have passes that other iterations lack.
fn times(passes: f64) -> String {
    if passes > 0.0 { format!("{passes:.0}") } else { "-".into() }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "scene {} on device {} (driver {})", self.scene, self.device, self.driver)?;
        if let Some(Chosen { preset, set }) = &self.preset {
            let set: Vec<String> = set.iter().map(|(key, value)| format!("{key} = {value}")).collect();
            let set = if set.is_empty() { "no key, since the scene sets every key".into() } else { set.join(", ") };
            writeln!(f, "preset {preset}: {set}")?;
        }
        writeln!(
            f,
            "a step of {} solver iterations: {} passes, {} of which wait for an earlier pass; {} of GPU memory\n",
            self.iterations,
            self.passes,
            self.dependent_passes,
            amount(self.bytes_device)
        )?;
        writeln!(f, "{:<34} {:>6} {:>6} {:>9}  why", "stage, pass", "passes", "waits", "bytes")?;
        for stage in &self.stages {
            let (passes, waits) = (times(stage.passes.into()), times(stage.dependent.into()));
            let why = if stage.recorded { stage.reason.clone() } else { format!("left out: {}", stage.reason) };
            writeln!(f, "{:<34} {passes:>6} {waits:>6} {:>9}  {why}", stage.stage, amount(stage.bytes_device))?;
            for kernel in &stage.kernels {
                let (passes, waits) = (times(kernel.passes), times(kernel.dependent));
                let why = if kernel.recorded { String::new() } else { format!("left out: {}", kernel.reason) };
                let line = format!("  {:<32} {passes:>6} {waits:>6} {:>9}  {why}", kernel.kernel, "");
                writeln!(f, "{}", line.trim_end())?;
            }
        }
        writeln!(f, "\n{:<28} {:<9} why", "feature", "")?;
        for Feature { feature, used, reason } in &self.features {
            writeln!(f, "{feature:<28} {:<9} {reason}", if *used { "used" } else { "left out" })?;
        }
        Ok(())
    }
}
