//! What `palpate run --explain` says: stages, their passes and arrays, and features. A table on the terminal, or JSON.

use std::fmt;

use serde::Serialize;

use super::{Entry, Feature};
use crate::gpu::Pass;
use crate::scene::preset::Chosen;

/// What one step does, and what it leaves out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explanation {
    /// The scene.
    pub scene: String,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// The preset that the scene names.
    pub preset: Option<Chosen>,
    /// Solver iterations of the step.
    pub iterations: u32,
    /// Passes of the step.
    pub passes: u32,
    /// Those that wait for an earlier one.
    pub dependent_passes: u32,
    /// Memory on the device, bytes, as the driver gives it out.
    pub bytes_device: u64,
    /// All stages in the order of the step.
    pub stages: Vec<StageUse>,
    /// All features.
    pub features: Vec<Feature>,
}

/// A stage, its passes and its arrays.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StageUse {
    /// The stage.
    pub stage: String,
    /// Whether it is recorded.
    pub recorded: bool,
    /// Why, or why not.
    pub reason: String,
    /// Passes.
    pub passes: u32,
    /// Those that wait for an earlier one.
    pub dependent: u32,
    /// Bytes on the device of arrays that this stage is the first to use.
    pub bytes_device: u64,
    /// Its kernels, fills and copies: first what is recorded.
    pub kernels: Vec<KernelUse>,
    /// Arrays that it is the first to use.
    pub arrays: Vec<Array>,
}

/// What a pass runs.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct KernelUse {
    /// The kernel (of a draw two, with a comma between them), or what is filled or copied to.
    pub kernel: String,
    /// Whether it is recorded.
    pub recorded: bool,
    /// Passes of the step; of a kernel that only further linearisations run none, where the step has none.
    pub passes: f64,
    /// Those that wait for an earlier one.
    pub dependent: f64,
    /// Why not, where it is not recorded.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub reason: String,
}

/// An array.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Array {
    /// Its name.
    pub name: String,
    /// Bytes asked for.
    pub bytes: u64,
    /// Whether it is in the device's own memory, not mapped for the host.
    pub on_device: bool,
}

impl StageUse {
    /// A stage of the plan, of which nothing is known yet.
    pub(crate) fn of(entry: &Entry) -> StageUse {
        let Entry { stage, recorded, reason } = entry;
        StageUse { stage: stage.to_string(), recorded: *recorded, reason: reason.clone(), ..StageUse::default() }
    }

    /// Adds a pass that a step runs so many times.
    pub(crate) fn count(&mut self, pass: &Pass, times: f64) {
        let at = self.kernels.iter().position(|known| known.kernel == pass.what).unwrap_or_else(|| {
            self.kernels.push(KernelUse { kernel: pass.what.clone(), recorded: true, ..KernelUse::default() });
            self.kernels.len() - 1
        });
        self.kernels[at].passes += times;
        self.kernels[at].dependent += if pass.waits { times } else { 0.0 };
    }

    /// Adds up what is known.
    pub(crate) fn close(&mut self) {
        let sum = |of: fn(&KernelUse) -> f64| self.kernels.iter().map(of).sum::<f64>().round() as u32;
        (self.passes, self.dependent) = (sum(|kernel| kernel.passes), sum(|kernel| kernel.dependent));
        self.bytes_device = self.arrays.iter().filter(|array| array.on_device).map(|array| array.bytes).sum();
    }
}

/// Bytes for a person.
fn amount(bytes: u64) -> String {
    match bytes {
        0 => "-".into(),
        1..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", 1e-3 * bytes as f64),
        _ => format!("{:.1} MB", 1e-6 * bytes as f64),
    }
}

/// A number of passes; those of a step of which each iteration is alike are whole.
fn times(passes: f64) -> String {
    if passes > 0.0 { format!("{passes:.0}") } else { "-".into() }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{} on {} ({})", self.scene, self.device, self.driver)?;
        if let Some(Chosen { preset, set }) = &self.preset {
            let set: Vec<String> = set.iter().map(|(key, value)| format!("{key} = {value}")).collect();
            let set = if set.is_empty() { "the file says all of it itself".into() } else { set.join(", ") };
            writeln!(f, "preset {preset}: {set}")?;
        }
        writeln!(
            f,
            "a step of {} iterations: {} passes, {} of them wait for an earlier one; {} on the device\n",
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
