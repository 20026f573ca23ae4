//! Steps that are submitted: a thread of the simulation's own does them, since a step needs the host between its parts on the
//! device. The thread begins with the first of them, and ends with the simulation.
//!
//! What is told of steps lies beside the simulation, not in it: it can be read while a step is under way.

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

const UNDER_WAY: &str = "a submitted step that is under way; poll until it is done";

/// What can be stepped.
pub(super) trait Stepped: Handled {
    /// Errors: it cannot go on.
    fn is_fit(&self) -> Outcome;
    /// One step.
    fn step_to(&mut self, device: Option<Pose>) -> Outcome<palpate_wrench>;
}

/// Those of a simulation.
pub(super) type SimulationSteps = Steps<SimulationObject>;

/// Those of a simulation's handle.
pub(super) fn of(simulation: *mut palpate_simulation) -> Outcome<Arc<SimulationSteps>> {
    handles::beside::<SimulationObject, _>(simulation as usize)
}

/// Takes a handle out of use, and waits for the step that is under way.
pub(super) fn remove<T: Stepped>(handle: usize) -> Outcome {
    let steps = handles::beside::<T, Steps<T>>(handle)?;
    handles::remove::<T>(handle)?;
    steps.end();
    Ok(())
}

/// The wrench of the newest step, and when that was given its pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Newest(Option<(palpate_wrench, Instant)>);

impl Newest {
    /// Before any step.
    pub const NONE: Newest = Newest(None);

    pub fn new(wrench: palpate_wrench, given: Instant) -> Newest {
        Newest(Some((wrench, given)))
    }

    /// Tells the caller both; `age` may be null.
    ///
    /// # Safety
    /// `wrench` is null or as long as it says, and `age` is null or can be written.
    pub unsafe fn tell(&self, wrench: *mut palpate_wrench, age: *mut f64) -> Outcome {
        let (told, seconds) = match &self.0 {
            Some((wrench, given)) => (*wrench, given.elapsed().as_secs_f64()),
            None => (palpate_wrench::unset(), f64::INFINITY),
        };
        if wrench.is_null() {
            return Err(Failure::new(palpate_status::Null, "wrench is null; say where the answer goes"));
        }
        // SAFETY: the caller's promise.
        unsafe { sized::write(wrench, &told)? };
        // SAFETY: the caller's promise.
        if let Some(age) = unsafe { age.as_mut() } {
            *age = seconds;
        }
        Ok(())
    }
}

/// Steps of one simulation, submitted or not.
pub(super) struct Steps<T: Stepped> {
    shared: Arc<Shared<T>>,
    worker: Mutex<Option<JoinHandle<()>>>,
}

struct Shared<T: Stepped> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T: Stepped> {
    /// What the worker has not taken yet.
    job: Option<Job<T>>,
    is_under_way: bool,
    newest: Newest,
    /// What a submitted step failed with; there is none after it.
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
        // It is whole between any two of its statements.
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State<T>>) -> MutexGuard<'a, State<T>> {
        self.changed.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Does what is submitted until it is told to end.
    fn work(&self) {
        while let Some(Job { lent, device, given }) = self.next() {
            // What a panic leaves behind is behind a lock that it poisons.
            let done = catch_unwind(AssertUnwindSafe(|| lent.lock().step_to(device)));
            match done.unwrap_or_else(|panic| Err(Failure::of_panic(&*panic))) {
                Ok(wrench) => self.lock().newest = Newest::new(wrench, given),
                Err(failure) => self.lock().failure = Some(failure),
            }
            // Given back before it is said to be done. It may be the last to hold it, and so drop these steps as well.
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
        // What was submitted before the end is done.
        state.job.take()
    }
}

impl<T: Stepped> Steps<T> {
    /// Begins a step on the worker.
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

    /// Sees to it that there is a worker.
    fn employ(&self) -> Outcome {
        let mut worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if worker.is_none() {
            let shared = Arc::clone(&self.shared);
            let thread = std::thread::Builder::new().name("palpate-step".into()).spawn(move || shared.work());
            let none = |error| Failure::new(palpate_status::Memory, format!("no thread for submitted steps: {error}"));
            *worker = Some(thread.map_err(none)?);
        }
        Ok(())
    }

    /// A step on the caller's thread, by whom the simulation belongs to now.
    pub fn step_now(&self, object: &mut T, device: Option<Pose>) -> Outcome<palpate_wrench> {
        let given = Instant::now();
        let wrench = object.step_to(device)?;
        self.note(Newest::new(wrench, given));
        Ok(wrench)
    }

    /// A state was taken up: what was before it is forgotten.
    pub fn forget(&self) {
        let mut state = self.shared.lock();
        (state.newest, state.failure) = (Newest::NONE, None);
    }

    /// A step was done elsewhere.
    pub fn note(&self, newest: Newest) {
        self.shared.lock().newest = newest;
    }

    /// Whether no step is under way, and what the last that was submitted failed with.
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

    /// Ends the worker, having waited for its step.
    fn end(&self) {
        self.shared.lock().ends = true;
        self.shared.changed.notify_all();
        let worker = self.worker.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        // A worker that was the last to hold its simulation does not wait for itself.
        if let Some(worker) = worker.filter(|worker| worker.thread().id() != std::thread::current().id()) {
            // It keeps its panics to itself.
            let _ = worker.join();
        }
    }
}

impl<T: Stepped> Drop for Steps<T> {
    fn drop(&mut self) {
        self.end();
    }
}

/// Begins a step, and does not wait for it: a thread of the simulation's, which begins with the first of these calls, does it.
/// `device`: as for `palpate_step`; may be null, and is not needed after the call. Until the step is done, what reads or
/// changes the simulation gives PALPATE_STATUS_BUSY, this call too; `palpate_step_poll`, `palpate_step_wait` and
/// `palpate_wrench_newest` do not. The steps are those of `palpate_step`, bit for bit.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step_submit(
    simulation: *mut palpate_simulation,
    device: *const palpate_pose,
) -> palpate_status {
    guarded(|| {
        let given = Instant::now();
        // SAFETY: the caller's, as the header says.
        let device = unsafe { sized::given(device, "device")? }.map(|pose| pose_of(pose, "device")).transpose()?;
        of(simulation)?.submit(simulation as usize, device, given)
    })
}

/// Whether the submitted step is done; never waits. `is_done` receives 1 where no submitted step is under way, else 0. Where a
/// submitted step failed it receives 1, and the call gives what the step failed with, as `palpate_step` would have; so does
/// every later one until a state is restored, for there is no step after that.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step_poll(simulation: *mut palpate_simulation, is_done: *mut i32) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let is_done = unsafe { sized::answer(is_done, "is_done")? };
        let (rests, told) = of(simulation)?.poll();
        *is_done = i32::from(rests);
        told
    })
}

/// Waits until no submitted step is under way. Gives what it failed with, as `palpate_step_poll` does.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_step_wait(simulation: *mut palpate_simulation) -> palpate_status {
    guarded(|| of(simulation)?.wait())
}

/// The wrench of the newest step that is done, whether it was submitted, a `palpate_step` or a loop's; never waits, and can be
/// asked by any thread at any time. `age_seconds` receives how long ago that step was given its pose (submitted, or called for,
/// or begun by the loop), s; it may be null. Before the first step the wrench has `step` 0, and its age is infinite. Where a
/// submitted step failed, both are still told, and the call gives what it failed with. A state that is restored has none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_wrench_newest(
    simulation: *mut palpate_simulation,
    wrench: *mut palpate_wrench,
    age_seconds: *mut f64,
) -> palpate_status {
    guarded(|| {
        let steps = of(simulation)?;
        let newest = steps.shared.lock().newest;
        // SAFETY: the caller's, as the header says.
        unsafe { newest.tell(wrench, age_seconds)? };
        steps.poll().1
    })
}
