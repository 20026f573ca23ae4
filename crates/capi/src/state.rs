//! States of simulations: saved as bytes, taken up again.

use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::{handles, sized, steps};

/// Saves all that the next step starts from: where everything is and how it moves, and what the solver and culling remember.
/// What was set is not in it (material, contact, coupling). Between two steps; costs a copy from the device.
/// `size` receives how many bytes it takes, which differs by some hundreds from step to step: ask just before. They are written
/// to `bytes`, which has room for `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_state_save(
    simulation: *mut palpate_simulation,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let size = unsafe { sized::answer(size, "size")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let state = object.simulation.save()?;
            *size = state.len();
            if capacity == 0 {
                return Ok(());
            }
            // SAFETY: the caller's, as the header says.
            unsafe { sized::copy(&state, bytes, capacity, "bytes") }
        })
    })
}

/// Takes up a state that was saved, of this simulation or of another of the same bodies, tool and device, in this process or
/// another: from there on both give the same bits, if the same was set. PALPATE_STATUS_ARGUMENT: the bytes are none that this
/// version saved, are damaged, or belong to other bodies; nothing changed. A simulation whose step failed goes on from the state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_state_restore(
    simulation: *mut palpate_simulation,
    bytes: *const u8,
    size: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let state = unsafe { sized::array(bytes, size, "bytes")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            object.simulation.restore(state).map_err(argument)?;
            object.has_failed = false;
            steps::of(simulation)?.forget();
            Ok(())
        })
    })
}

/// What a user's value was refused for is an argument's fault here, not a scene's.
pub(super) fn argument(error: palpate::Error) -> Failure {
    match error {
        palpate::Error::Usage(message) => Failure::new(palpate_status::Argument, message),
        other => other.into(),
    }
}

/// Does something to a simulation, whose refusals are about arguments.
pub(super) fn change(
    simulation: *mut palpate_simulation,
    work: impl FnOnce(&mut palpate::Simulation) -> palpate::Result<()>,
) -> Outcome {
    handles::with(simulation as usize, |object: &mut SimulationObject| {
        let done = work(&mut object.simulation);
        // What the device failed at halfway is neither what it was nor what it was to be.
        object.has_failed |= done.as_ref().is_err_and(|error| !matches!(error, palpate::Error::Usage(_)));
        done.map_err(argument)
    })
}
