//! Saves the state of a simulation as bytes, and restores it.

use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::{handles, sized, steps};

/// Saves everything that the next step starts from: positions and velocities of all bodies and the tool, and the data
/// that the solver and the broad phase carry over from step to step. Settings (materials, contact law, coupling) are
/// not part of the state. Call the function between two steps; it copies arrays from the GPU. `size` receives the
/// number of bytes, which differs by some hundreds from step to step: ask for it just before saving. The bytes are
/// written to `bytes`, which has room for `capacity` of them and may be null if `capacity` is 0.
/// PALPATE_STATUS_TOO_SMALL: there are more than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_state_save(
    simulation: *mut palpate_simulation,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let size = unsafe { sized::answer(size, "size")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let state = object.simulation.save()?;
            *size = state.len();
            if capacity == 0 {
                return Ok(());
            }
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::copy(&state, bytes, capacity, "bytes") }
        })
    })
}

/// Restores a saved state, of this simulation or of another with the same bodies, tool and Vulkan device, in this
/// process or another: from then on both simulations compute the same bits, if they have the same settings.
/// PALPATE_STATUS_ARGUMENT: the bytes were not saved by this version, are damaged, or belong to other bodies; nothing
/// changed. A simulation whose step had failed continues from the restored state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_state_restore(
    simulation: *mut palpate_simulation,
    bytes: *const u8,
    size: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let state = unsafe { sized::array(bytes, size, "bytes")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            object.simulation.restore(state).map_err(argument)?;
            object.has_failed = false;
            steps::of(simulation)?.forget();
            Ok(())
        })
    })
}

/// Turns the engine's error about a wrong value into an argument error, because here the value is an argument of the
/// call and not part of a scene.
pub(super) fn argument(error: palpate::Error) -> Failure {
    match error {
        palpate::Error::Usage(message) => Failure::new(palpate_status::Argument, message),
        other => other.into(),
    }
}

/// Changes a simulation by `work`; a value that the engine refuses becomes an argument error.
pub(super) fn change(
    simulation: *mut palpate_simulation,
    work: impl FnOnce(&mut palpate::Simulation) -> palpate::Result<()>,
) -> Outcome {
    handles::with(simulation as usize, |object: &mut SimulationObject| {
        let done = work(&mut object.simulation);
        // After a failure of the GPU halfway, the simulation is neither in its old state nor in the new one.
        object.has_failed |= done.as_ref().is_err_and(|error| !matches!(error, palpate::Error::Usage(_)));
        done.map_err(argument)
    })
}
