//! The plan of a simulation: the passes (kernels, fills and copies on the GPU) that one time step runs, and the GPU
//! memory that they need. `palpate bench features` compares the plans of a scene with a feature of the engine and of a
//! scene without this feature; no step has to be run for that.

use palpate::Simulation;
use serde::{Deserialize, Serialize};

/// Number of iterations of the linear solver in the step whose passes are counted.
pub const ITERATIONS: u32 = 16;

/// Passes and memory of a step. Simulations with equal plans run the same passes and allocate the same memory.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Name of each kernel, fill and copy that a step runs, and the number of times that a step of `ITERATIONS` solver
    /// iterations runs it.
    pub kernels: Vec<(String, f64)>,
    /// Name and size (bytes) of each array of the step.
    pub arrays: Vec<(String, u64)>,
    /// Number of passes in a step of `ITERATIONS` solver iterations.
    pub passes: u32,
    /// Number of passes in such a step that wait for an earlier pass.
    pub dependent_passes: u32,
    /// GPU memory that the driver allocated for the simulation, bytes.
    pub bytes_device: u64,
}

impl Plan {
    /// The plan of a simulation, read from its recorded GPU commands.
    pub fn of(simulation: &Simulation) -> Plan {
        let explained = simulation.explain(ITERATIONS);
        let kernels = explained.stages.iter().flat_map(|stage| &stage.kernels).filter(|kernel| kernel.recorded);
        let arrays = explained.stages.iter().flat_map(|stage| &stage.arrays);
        Plan {
            kernels: kernels.map(|kernel| (kernel.kernel.clone(), kernel.passes)).collect(),
            arrays: arrays.map(|array| (array.name.clone(), array.bytes)).collect(),
            passes: explained.passes,
            dependent_passes: explained.dependent_passes,
            // This is the sum over all buffers and images of the simulation's GPU context.
            bytes_device: simulation.context().bytes_allocated(),
        }
    }

    /// The kernels and the memory that this plan has and the plan `other` lacks, in words.
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
