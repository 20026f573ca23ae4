//! Functions that save the state of a simulation as bytes, and restore a saved state. The tool is the rigid body that
//! the haptic device leads, by the spring and damper of the virtual coupling.

use palpate::StepReport;

use super::simulation::{SimulationObject, palpate_simulation};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::{handles, sized, steps};

/// Saves the state of a simulation, that is, everything that the next step starts from: positions and velocities of all
/// bodies and the tool, and the data that the solver and the broad phase of collision detection carry over from step to
/// step. Settings (materials, contact law, virtual coupling) are not part of the state. Call the function between two
/// steps; it copies arrays from the GPU. `size` receives the number of bytes, which changes by some hundreds of bytes
/// from step to step; so ask for the size just before saving. `bytes` has room for `capacity` bytes, and may be null if
/// `capacity` is 0, which asks for the size alone. PALPATE_STATUS_TOO_SMALL: the state has more bytes than `capacity`,
/// which is not 0, and none was written.
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

/// Restores a state that was saved from this simulation, or from another simulation with the same bodies, tool and
/// Vulkan device, in this process or another one. If the settings too are the same, the next steps compute the same
/// bits as the steps after the state was saved. PALPATE_STATUS_ARGUMENT: the bytes were not saved by this version of
/// the library, are damaged, or belong to other bodies; nothing was changed. A simulation with a failed step can do
/// steps again after a state is restored.
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
            (object.has_failed, object.last) = (false, StepReport::default());
            steps::of(simulation)?.forget();
            Ok(())
        })
    })
}

/// Turns the engine's error about a wrong value (`Usage`) into an argument error, because in the calls that use this
/// function the value is an argument and not part of a scene.
pub(super) fn argument(error: palpate::Error) -> Failure {
    match error {
        palpate::Error::Usage(message) => Failure::new(palpate_status::Argument, message),
        other => other.into(),
    }
}

/// Changes a simulation by `work`. If the engine refuses a value, the result is an argument error.
pub(super) fn change(
    simulation: *mut palpate_simulation,
    work: impl FnOnce(&mut palpate::Simulation) -> palpate::Result<()>,
) -> Outcome {
    handles::with(simulation as usize, |object: &mut SimulationObject| {
        let done = work(&mut object.simulation);
        // If the GPU failed halfway through the change, the simulation is neither in its old state nor in the new one,
        // so no further step is allowed.
        object.has_failed |= done.as_ref().is_err_and(|error| !matches!(error, palpate::Error::Usage(_)));
        done.map_err(argument)
    })
}
