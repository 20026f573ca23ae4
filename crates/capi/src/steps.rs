//! Submitted steps, for which the caller does not wait. Each simulation has a worker thread that does its submitted
//! steps, because a step needs the CPU between its parts on the GPU. The thread starts with the first submitted step
//! and ends with the simulation.
//!
//! The result of a step is a wrench (contact force and torque on the tool, the rigid body that the haptic device
//! leads). Results are stored in the companion of the simulation's handle (`handles.rs`), which is data that any thread
//! may use while another thread uses the simulation, so that results can be read while a step is under way.

#[cfg(test)]
mod tests;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Instant;

use palpate::Pose;

use super::handles::{self, Handled, Lent};
use super::simulation::{SimulationObject, palpate_pose, palpate_simulation, palpate_wrench, pose_of};
use super::sized::{self, Sized32};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// Words that complete the error "the simulation is in use by ...", which other calls give during a submitted step.
const UNDER_WAY: &str = "a submitted step that is under way; poll until it is done";

/// An object that can do steps: a simulation, or in tests a substitute for a simulation.
pub(super) trait Stepped: Handled {
    /// Checks whether a step is possible. Errors: the reason why no step is possible.
    fn is_fit(&self) -> Outcome;
    /// Does one step, at the end of which haptic devices have the poses `devices`, tool by tool. A device without a pose
    /// is where the scene's trajectory leads it or, if an earlier step was given a pose, at the last pose given.
    fn step_to(&mut self, devices: &[Pose]) -> Outcome<palpate_wrench>;
}

/// Worker thread and results of the steps of one simulation.
pub(super) type SimulationSteps = Steps<SimulationObject>;

/// Returns the companion of a simulation's handle: the worker thread and the results of the simulation's steps.
pub(super) fn of(simulation: *mut palpate_simulation) -> Outcome<Arc<SimulationSteps>> {
    handles::beside::<SimulationObject, _>(simulation as usize)
}

/// Removes a handle, and waits for the step that is under way, if there is one.
pub(super) fn remove<T: Stepped>(handle: usize) -> Outcome {
    let steps = handles::beside::<T, Steps<T>>(handle)?;
    handles::remove::<T>(handle)?;
    steps.end();
    Ok(())
}

/// The wrench of the newest step, and the time at which that step received the pose of the haptic device; `None` before
/// the first step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Newest(Option<(palpate_wrench, Instant)>);

impl Newest {
    /// The value before the first step.
    pub const NONE: Newest = Newest(None);

    /// `given`: time at which the step received the pose of the haptic device.
    pub fn new(wrench: palpate_wrench, given: Instant) -> Newest {
        Newest(Some((wrench, given)))
    }

    /// Writes to the caller's variables the wrench, and the time since the wrench's step received the pose of the
    /// haptic device (`age`, s). `age` may be null.
    ///
    /// # Safety
    /// `wrench` is null, or leads to a struct with as many bytes as its first field states. `age` is null, or leads to
    /// a variable that can be written.
    pub unsafe fn tell(&self, wrench: *mut palpate_wrench, age: *mut f64) -> Outcome {
        let (told, seconds) = match &self.0 {
            Some((wrench, given)) => (*wrench, given.elapsed().as_secs_f64()),
            None => (palpate_wrench::unset(), f64::INFINITY),
        };
        if wrench.is_null() {
            return Err(Failure::new(palpate_status::Null, "wrench is null; pass the address for the answer"));
        }
        // SAFETY: the caller keeps the conditions under `# Safety`.
        unsafe { sized::write(wrench, &told)? };
        // SAFETY: the caller keeps the conditions under `# Safety`.
        if let Some(age) = unsafe { age.as_mut() } {
            *age = seconds;
        }
        Ok(())
    }
}

/// Worker thread and results of the steps, submitted or not, of one object, which is usually a simulation.
pub(super) struct Steps<T: Stepped> {
    shared: Arc<Shared<T>>,
    worker: Mutex<Option<JoinHandle<()>>>,
}

struct Shared<T: Stepped> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T: Stepped> {
    /// A submitted step that the worker has not taken yet.
    job: Option<Job<T>>,
    is_under_way: bool,
    newest: Newest,
    /// Failure of a submitted step. After a failure no further step is possible until a saved state is restored.
    failure: Option<Failure>,
    ends: bool,
}

struct Job<T: Stepped> {
    lent: Lent<T>,
    device: Option<Pose>,
    given: Instant,
}

impl<T: Stepped> Default for Steps<T> {
    fn default() -> Self {
        let state = State { job: None, is_under_way: false, newest: Newest::NONE, failure: None, ends: false };
        let shared = Shared { state: Mutex::new(state), changed: Condvar::new() };
        Steps { shared: Arc::new(shared), worker: Mutex::new(None) }
    }
}

impl<T: Stepped> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // A panic cannot leave the state half-changed: the state is consistent between any two statements under the
        // lock.
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State<T>>) -> MutexGuard<'a, State<T>> {
        self.changed.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Runs on the worker thread: does submitted steps until the flag `ends` of the state is set.
    fn work(&self) {
        while let Some(Job { lent, device, given }) = self.next() {
            // Unwind safety: a panic during the step poisons the lock of the object, so no other call uses the object,
            // which may be half-changed.
            let done = catch_unwind(AssertUnwindSafe(|| lent.lock().step_to(device.as_slice())));
            match done.unwrap_or_else(|panic| Err(Failure::of_panic(&*panic))) {
                Ok(wrench) => self.lock().newest = Newest::new(wrench, given),
                Err(failure) => self.lock().failure = Some(failure),
            }
            // The object is released before the step is reported as done. If this thread is the last owner of the
            // object, the object's companion, which owns this worker thread, is dropped here as well.
            drop(lent);
            let mut state = self.lock();
            state.is_under_way = false;
            self.changed.notify_all();
        }
    }

    fn next(&self) -> Option<Job<T>> {
        let mut state = self.lock();
        while state.job.is_none() && !state.ends {
            state = self.wait(state);
        }
        // A step that was submitted before `ends` was set is still done.
        state.job.take()
    }
}

impl<T: Stepped> Steps<T> {
    /// Begins a step on the worker thread. `given`: time at which the caller gave the pose `device`.
    fn submit(&self, handle: usize, device: Option<Pose>, given: Instant) -> Outcome {
        let mut state = self.shared.lock();
        if state.is_under_way {
            return Err(Failure::new(palpate_status::Busy, format!("the {} is in use by {UNDER_WAY}", T::NAME)));
        }
        let lent = handles::lend::<T>(handle, UNDER_WAY)?;
        lent.lock().is_fit()?;
        self.employ()?;
        state.job = Some(Job { lent, device, given });
        state.is_under_way = true;
        self.shared.changed.notify_all();
        Ok(())
    }

    /// Starts the worker thread, unless it already runs.
    fn employ(&self) -> Outcome {
        let mut worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if worker.is_none() {
            let shared = Arc::clone(&self.shared);
            let thread = std::thread::Builder::new().name("palpate-step".into()).spawn(move || shared.work());
            let none = |error| Failure::new(palpate_status::Memory, format!("cannot start the worker thread: {error}"));
            *worker = Some(thread.map_err(none)?);
        }
        Ok(())
    }

    /// Does a step on the calling thread, which has locked the simulation.
    pub fn step_now(&self, object: &mut T, devices: &[Pose]) -> Outcome<palpate_wrench> {
        let given = Instant::now();
        let wrench = object.step_to(devices)?;
        self.note(Newest::new(wrench, given));
        Ok(wrench)
    }

    /// Forgets the wrench and the failure of earlier steps; called when a saved state was restored.
    pub fn forget(&self) {
        let mut state = self.shared.lock();
        (state.newest, state.failure) = (Newest::NONE, None);
    }

    /// Stores the wrench of a step that was done on another thread than the worker.
    pub fn note(&self, newest: Newest) {
        self.shared.lock().newest = newest;
    }

    /// Returns first whether no step is under way, and second the failure of a submitted step, if one failed.
    fn poll(&self) -> (bool, Outcome) {
        let state = self.shared.lock();
        (!state.is_under_way, state.failure.clone().map_or(Ok(()), Err))
    }

    fn wait(&self) -> Outcome {
        let mut state = self.shared.lock();
        while state.is_under_way {
            state = self.shared.wait(state);
        }
        state.failure.clone().map_or(Ok(()), Err)
    }

    /// Ends the worker thread, after waiting until it has done its step.
    fn end(&self) {
        self.shared.lock().ends = true;
        self.shared.changed.notify_all();
        let worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        // If the worker thread was the last owner of the simulation, this function runs on the worker thread, which
        // must not wait for itself.
        if let Some(worker) = worker.filter(|worker| worker.thread().id() != std::thread::current().id()) {
            // The result of joining is ignored, because the worker thread catches and reports its panics itself.
            let _ = worker.join();
        }
    }
}

impl<T: Stepped> Drop for Steps<T> {
    fn drop(&mut self) {
        self.end();
    }
}

/// Begins a step without waiting for it: a worker thread of the simulation does the step. The first call of this
/// function starts the thread. `device` has the meaning that it has in `palpate_step`; it may be null, and is copied.
/// Until the step is done, functions that read or change the simulation, this one included, give PALPATE_STATUS_BUSY;
/// only `palpate_step_poll`, `palpate_step_wait` and `palpate_wrench_newest` can be used. A submitted step gives the
/// same bits as a step by `palpate_step`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step_submit(
    simulation: *mut palpate_simulation,
    device: *const palpate_pose,
) -> palpate_status {
    guarded(|| {
        let given = Instant::now();
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let device = unsafe { sized::given(device, "device")? }.map(|pose| pose_of(pose, "device")).transpose()?;
        of(simulation)?.submit(simulation as usize, device, given)
    })
}

/// Reads whether the submitted step is done; never waits. `is_done` receives 0 while a submitted step is under way, and
/// otherwise 1. If a submitted step failed, the call returns the status that `palpate_step` would have returned for
/// that step; all later calls return this status too, until a saved state is restored, because before that no further
/// step is possible.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step_poll(simulation: *mut palpate_simulation, is_done: *mut i32) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let is_done = unsafe { sized::answer(is_done, "is_done")? };
        let (rests, told) = of(simulation)?.poll();
        *is_done = i32::from(rests);
        told
    })
}

/// Waits until no submitted step is under way. If a submitted step failed, the call returns the status of that step, as
/// `palpate_step_poll` does.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_step_wait(simulation: *mut palpate_simulation) -> palpate_status {
    guarded(|| of(simulation)?.wait())
}

/// Reads the wrench of the newest finished step, which `palpate_step_submit`, `palpate_step` or a haptic loop began.
/// The call never waits; any thread may make it at any time. `age_seconds` receives the age of the wrench, s: the time
/// since its step received the pose of the haptic device, which was when `palpate_step_submit` or `palpate_step` was
/// called, or when the loop began the step. `age_seconds` may be null. Before the first step, and after a saved state
/// was restored, the wrench has `step` 0, and its age is infinite. If a submitted step failed, wrench and age are
/// written nevertheless, and the call returns the status of that step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_wrench_newest(
    simulation: *mut palpate_simulation,
    wrench: *mut palpate_wrench,
    age_seconds: *mut f64,
) -> palpate_status {
    guarded(|| {
        let steps = of(simulation)?;
        let newest = steps.shared.lock().newest;
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { newest.tell(wrench, age_seconds)? };
        steps.poll().1
    })
}
