//! Submitted steps, for which the caller does not wait: each simulation has a worker thread that does them, because a
//! step needs the CPU between its parts on the GPU. The thread starts with the first submitted step and ends with the
//! simulation.
//!
//! Results of steps are stored in the companion of the simulation's handle (`handles.rs`: data that any thread may use
//! while another thread uses the simulation), so that they can be read while a step is under way.

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

/// Completes the error "the simulation is in use by ..." of other calls during a submitted step.
const UNDER_WAY: &str = "a submitted step that is under way; poll until it is done";

/// An object that can be stepped: a simulation, or a substitute for one in tests.
pub(super) trait Stepped: Handled {
    /// Checks whether a step is possible. Errors: why it is not.
    fn is_fit(&self) -> Outcome;
    /// Does one step, at the end of which the haptic device has this pose; `None`: the pose on the scene's trajectory.
    fn step_to(&mut self, device: Option<Pose>) -> Outcome<palpate_wrench>;
}

/// The steps of a simulation.
pub(super) type SimulationSteps = Steps<SimulationObject>;

/// Returns the steps of the simulation behind a handle.
pub(super) fn of(simulation: *mut palpate_simulation) -> Outcome<Arc<SimulationSteps>> {
    handles::beside::<SimulationObject, _>(simulation as usize)
}

/// Removes a handle, and waits for the step that is under way.
pub(super) fn remove<T: Stepped>(handle: usize) -> Outcome {
    let steps = handles::beside::<T, Steps<T>>(handle)?;
    handles::remove::<T>(handle)?;
    steps.end();
    Ok(())
}

/// The wrench of the newest step, and the time at which that step received the pose of the haptic device (`given`).
#[derive(Debug, Clone, Copy)]
pub(super) struct Newest(Option<(palpate_wrench, Instant)>);

impl Newest {
    /// No step has been done.
    pub const NONE: Newest = Newest(None);

    pub fn new(wrench: palpate_wrench, given: Instant) -> Newest {
        Newest(Some((wrench, given)))
    }

    /// Writes the wrench, and the time since its step received the pose of the haptic device (s), to the caller's
    /// variables; `age` may be null.
    ///
    /// # Safety
    /// `wrench` is null or has as many bytes as its first field states, and `age` is null or can be written.
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

/// The steps of one simulation, submitted or not, and its worker thread.
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
    /// Failure of a submitted step; no further step is possible until a state is restored.
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
        // A panic cannot leave the state half-changed: it is consistent between any two statements under the lock.
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State<T>>) -> MutexGuard<'a, State<T>> {
        self.changed.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Loop of the worker thread: does submitted steps until `ends` is set.
    fn work(&self) {
        while let Some(Job { lent, device, given }) = self.next() {
            // Unwind safety: a panic poisons the lock of the object, so no other call uses a half-changed object.
            let done = catch_unwind(AssertUnwindSafe(|| lent.lock().step_to(device)));
            match done.unwrap_or_else(|panic| Err(Failure::of_panic(&*panic))) {
                Ok(wrench) => self.lock().newest = Newest::new(wrench, given),
                Err(failure) => self.lock().failure = Some(failure),
            }
            // The object is released before the step is reported as done. This thread may be the last owner of the
            // object; if so, its companion, to which this worker belongs, is dropped here as well.
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
        // A step that was submitted before the end is still done.
        state.job.take()
    }
}

impl<T: Stepped> Steps<T> {
    /// Begins a step on the worker thread.
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

    /// Starts the worker thread if there is none.
    fn employ(&self) -> Outcome {
        let mut worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if worker.is_none() {
            let shared = Arc::clone(&self.shared);
            let thread = std::thread::Builder::new().name("palpate-step".into()).spawn(move || shared.work());
            let none =
                |error| Failure::new(palpate_status::Memory, format!("cannot start the thread of steps: {error}"));
            *worker = Some(thread.map_err(none)?);
        }
        Ok(())
    }

    /// Does a step on the calling thread, which has the simulation locked.
    pub fn step_now(&self, object: &mut T, device: Option<Pose>) -> Outcome<palpate_wrench> {
        let given = Instant::now();
        let wrench = object.step_to(device)?;
        self.note(Newest::new(wrench, given));
        Ok(wrench)
    }

    /// Forgets wrench and failure of earlier steps, because a state was restored.
    pub fn forget(&self) {
        let mut state = self.shared.lock();
        (state.newest, state.failure) = (Newest::NONE, None);
    }

    /// Stores the wrench of a step that was done on another thread than the worker.
    pub fn note(&self, newest: Newest) {
        self.shared.lock().newest = newest;
    }

    /// Returns whether no step is under way, and the failure of a submitted step, if one failed.
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

    /// Ends the worker thread, after waiting for its step.
    fn end(&self) {
        self.shared.lock().ends = true;
        self.shared.changed.notify_all();
        let worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        // If the worker itself was the last owner of the simulation, this runs on its thread, which must not wait for
        // itself.
        if let Some(worker) = worker.filter(|worker| worker.thread().id() != std::thread::current().id()) {
            // The result is ignored: the worker catches its panics and reports them itself.
            let _ = worker.join();
        }
    }
}

impl<T: Stepped> Drop for Steps<T> {
    fn drop(&mut self) {
        self.end();
    }
}

/// Begins a step without waiting for it: a worker thread of the simulation does the step. The first such call starts
/// the thread. `device`: as in `palpate_step`; it may be null, and is copied. Until the step is done, calls that read
/// or change the simulation give PALPATE_STATUS_BUSY, this one too; `palpate_step_poll`, `palpate_step_wait` and
/// `palpate_wrench_newest` do not. Submitted steps give the same bits as those of `palpate_step`.
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
/// 1 otherwise. If a submitted step failed, the call returns the status of that step, as `palpate_step` would have
/// done; so do all later calls until a state is restored, because no further step is possible before that.
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

/// Waits until no submitted step is under way. Returns the status of a failed step, as `palpate_step_poll` does.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_step_wait(simulation: *mut palpate_simulation) -> palpate_status {
    guarded(|| of(simulation)?.wait())
}

/// Reads the wrench of the newest finished step, be it of `palpate_step_submit`, of `palpate_step` or of a loop. Never
/// waits; any thread may call it at any time. `age_seconds` receives the time since that step received the pose of the
/// haptic device (when `palpate_step_submit` or `palpate_step` was called, or when the loop began the step), s; it may
/// be null. Before the first step, and after a state was restored, the wrench has `step` 0, and its age is infinite. If
/// a submitted step failed, both are written nevertheless, and the call returns the status of that step.
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
