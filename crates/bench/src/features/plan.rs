//! Passes and memory of a step: costs of a feature that are known without running the step.

use palpate::Simulation;
use serde::{Deserialize, Serialize};

/// Number of solver iterations of the step whose passes are counted.
pub const ITERATIONS: u32 = 16;

/// Passes and memory of a step; steps with equal plans record the same passes and allocate the same memory.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Recorded kernels, fills and copies in their order, and how often each runs in a step of `ITERATIONS` solver
    /// iterations.
    pub kernels: Vec<(String, f64)>,
    /// GPU arrays by name, and their sizes, bytes.
    pub arrays: Vec<(String, u64)>,
    /// Passes of a step of `ITERATIONS` solver iterations.
    pub passes: u32,
    /// Passes of the same step that wait for an earlier pass.
    pub dependent_passes: u32,
    /// GPU memory that the driver allocated for the simulation, bytes.
    pub bytes_device: u64,
}

impl Plan {
    /// The plan of a simulation, read from its recordings.
    pub fn of(simulation: &Simulation) -> Plan {
        let explained = simulation.explain(ITERATIONS);
        let kernels = explained.stages.iter().flat_map(|stage| &stage.kernels).filter(|kernel| kernel.recorded);
        let arrays = explained.stages.iter().flat_map(|stage| &stage.arrays);
        Plan {
            kernels: kernels.map(|kernel| (kernel.kernel.clone(), kernel.passes)).collect(),
            arrays: arrays.map(|array| (array.name.clone(), array.bytes)).collect(),
            passes: explained.passes,
            dependent_passes: explained.dependent_passes,
            // This counts all buffers of the GPU context, including those of recordings and mapped ones.
            bytes_device: simulation.context().bytes_allocated(),
        }
    }

    /// The kernels and the memory that this plan has beyond another one, in words.
    pub fn beyond(&self, other: &Plan) -> String {
        let new: Vec<&str> = self
            .kernels
            .iter()
            .filter(|(name, _)| other.kernels.iter().all(|(known, _)| known != name))
            .map(|(name, _)| name.as_str())
            .collect();
        let larger = self.arrays.iter().filter(|(name, bytes)| {
            let known = other.arrays.iter().find(|(known, _)| known == name);
            known.is_none_or(|(_, other)| bytes > other)
        });
        let kernels = if new.is_empty() { "no kernel".into() } else { new.join(", ") };
        let bytes = self.bytes_device.saturating_sub(other.bytes_device);
        match (larger.count(), bytes) {
            (0, 0) => format!("{kernels}, no memory"),
            (arrays, bytes) => format!("{kernels}, {:.1} kB, {arrays} arrays are new or larger", 1e-3 * bytes as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_plan_has_beyond_another() {
        let plan = |kernels: &[&str], arrays: &[(&str, u64)]| Plan {
            kernels: kernels.iter().map(|name| (name.to_string(), 1.0)).collect(),
            arrays: arrays.iter().map(|(name, bytes)| (name.to_string(), *bytes)).collect(),
            bytes_device: arrays.iter().map(|(_, bytes)| bytes).sum(),
            ..Plan::default()
        };
        let small = plan(&["a"], &[("x", 1000), ("y", 1000)]);
        let large = plan(&["a", "b"], &[("x", 1000), ("y", 3000), ("z", 500)]);
        assert_eq!(large.beyond(&small), "b, 2.5 kB, 2 arrays are new or larger");
        assert_eq!(small.beyond(&large), "no kernel, no memory");
    }
}
