//! What steps cost, stage by stage.

use std::ffi::c_char;

use super::context::room;
use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{guarded, palpate_status};
use super::{handles, sized};

/// What a stage of the step costs.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_stage {
    /// Its name, as in the README: "pose", "cull", "skin", "depth", "contact", "elastic", "solve", "wrench" and so on; in every
    /// second timed step the first five are one, "pose to contact".
    pub name: [c_char; 32],
    /// On the device in the last step, microseconds; 0 where that was not timed.
    pub microseconds: f64,
    /// Dispatches, draws, fills and copies in a step like the last; 0 of "pose to contact".
    pub passes: u32,
    /// 0.
    pub reserved: u32,
}

/// Times every so many steps from now on; 0, as at the beginning: none. A timed step is up to a millisecond slower on some
/// drivers.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_time_every(simulation: *mut palpate_simulation, steps: u64) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| Ok(object.simulation.time_every(steps)?))
    })
}

/// The stages of the step, in their order, and what each costs. `count` receives how many there are; `stages` has room for
/// `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_stages(
    simulation: *mut palpate_simulation,
    stages: *mut palpate_stage,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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
            // SAFETY: the caller's, as the header says.
            if capacity == 0 { Ok(()) } else { unsafe { sized::copy(&all, stages, capacity, "stages") } }
        })
    })
}
