//! Functions that measure and list what each stage of a simulation step costs: its time on the GPU, and its number of
//! passes (dispatches, draws, fills and copies).

use std::ffi::c_char;

use super::context::room;
use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{guarded, palpate_status};
use super::{handles, sized};

/// Cost of one stage of a simulation step.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_stage {
    /// Name of the stage, as in docs/understanding/step.md: "pose", "cull", "skin", "depth", "contact", "elastic", "solve", "wrench"
    /// and so on. In every second timed step, "pose to contact" stands for the first five of these stages, which are
    /// then timed together.
    pub name: [c_char; 32],
    /// Time of the stage on the GPU in the last step, microseconds; 0 if the last step was not timed.
    pub microseconds: f64,
    /// Number of dispatches, draws, fills and copies of the stage in a step with as many solver iterations as the last
    /// one; 0 for "pose to contact".
    pub passes: u32,
    /// Reserved: always 0.
    pub reserved: u32,
}

/// Times the stages of every `steps`-th step from now on. With `steps` 0, which is the default, no step is timed. With
/// some drivers a timed step takes up to a millisecond longer.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_time_every(simulation: *mut palpate_simulation, steps: u64) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| Ok(object.simulation.time_every(steps)?))
    })
}

/// Lists the stages of a step in the order in which they run, with the cost of each. `count` receives the number of
/// stages; `stages` has room for `capacity` stages, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there
/// are more stages than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_stages(
    simulation: *mut palpate_simulation,
    stages: *mut palpate_stage,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let simulation = &object.simulation;
            let (passes, _) = simulation.passes(simulation.last_iterations());
            let stage = |name: &str, microseconds, passes| palpate_stage {
                name: room(name),
                microseconds,
                passes,
                reserved: 0,
            };
            let passes_of =
                |name: &str| passes.iter().find(|(stage, _)| stage == name).map_or(0, |(_, passes)| *passes);
            let all: Vec<palpate_stage> = match simulation.stage_times() {
                Some(times) => times.iter().map(|(name, us)| stage(name, *us, passes_of(name))).collect(),
                None => passes.iter().map(|(name, passes)| stage(name, 0.0, *passes)).collect(),
            };
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::list(&all, stages, capacity, count, "stages") }
        })
    })
}
