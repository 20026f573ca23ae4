//! Costs of a step by stage: times on the GPU, and numbers of passes (dispatches, draws, fills and copies).

use std::ffi::c_char;

use super::context::room;
use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{guarded, palpate_status};
use super::{handles, sized};

/// Cost of a stage of the step.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_stage {
    /// Name of the stage, as in the README: "pose", "cull", "skin", "depth", "contact", "elastic", "solve", "wrench"
    /// and so on. In every second timed step the first five stages are timed together, as one stage "pose to contact".
    pub name: [c_char; 32],
    /// Time on the GPU in the last step, microseconds; 0 where that step was not timed.
    pub microseconds: f64,
    /// Number of dispatches, draws, fills and copies in a step like the last; 0 for "pose to contact".
    pub passes: u32,
    /// Reserved: always 0.
    pub reserved: u32,
}

/// Times every `steps`-th step from now on; 0, which is the default: no step is timed. A timed step is up to a
/// millisecond slower with some drivers.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_time_every(simulation: *mut palpate_simulation, steps: u64) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| Ok(object.simulation.time_every(steps)?))
    })
}

/// Lists the stages of the step in order, with the cost of each. `count` receives their number; `stages` has room for
/// `capacity` of them, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more than `capacity`,
/// and none was written.
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
            *count = all.len();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            if capacity == 0 { Ok(()) } else { unsafe { sized::copy(&all, stages, capacity, "stages") } }
        })
    })
}
