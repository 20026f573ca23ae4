//! The haptic loop of the C ABI: functions that start, watch and stop it. A loop is one run of the engine's haptic
//! session on a thread of its own. At a fixed rate the loop reads the caller's haptic devices and plays the contact
//! forces on them; meanwhile the simulation does steps. A device leads its tool (a rigid body) through the virtual
//! coupling, a spring and damper.

use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::session::{self, Leader, Options, Report};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene;

use super::handles::{self, Handled, Lent};
use super::haptic_device::{Callbacks, is_in_callback, palpate_haptic_device};
use super::loop_options::{chosen, palpate_loop_options};
use super::loop_state::{Led, Told, palpate_loop_state};
use super::simulation::{SimulationObject, palpate_simulation, palpate_wrench, wrench_of_tool};
use super::sized::{self, Sized32};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::steps::{self, Newest, SimulationSteps, Stepped};

/// Completes the error "the simulation is in use by ...", which other calls give while a loop runs.
const HELD: &str = "a loop; stop that loop first";

/// A haptic loop: at the loop's rate (1000 Hz unless the scene or the options set another) a haptic device, or one for
/// each of several tools, is read and a force is played on it, and meanwhile a simulation does steps.
pub struct palpate_loop {
    _opaque: [u8; 0],
}

/// The object behind a loop's handle. It is empty: all data are in its companion, a [`Loop`], which any number of
/// threads may use at once.
struct LoopObject;

impl Handled for LoopObject {
    const NAME: &str = "loop";
}

struct Loop {
    told: Told,
    stop: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// Everything that the loop's thread works with while the loop runs.
struct Work {
    lent: Lent<SimulationObject>,
    steps: Arc<SimulationSteps>,
    leaders: Vec<Leader>,
    options: Options,
}

/// The simulation as the environment that the tools touch. It also stores the wrenches (contact force and torque on a
/// tool) of each step, for callers that read the newest.
struct Felt<'a> {
    object: &'a mut SimulationObject,
    steps: &'a SimulationSteps,
    told: &'a Told,
}

impl Environment for Felt<'_> {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> palpate::Result<Vec<ContactWrench>> {
        let begun = Instant::now();
        let row = self.object.simulation.step_device_inputs(inputs, h);
        self.object.has_failed = row.is_err();
        self.object.last = row?;
        let newest = |tool| Newest::new(wrench_of_tool(&self.object.last, tool), begun);
        self.steps.note(newest(0));
        self.told.note((0..inputs.len()).map(newest));
        Ok(self.object.simulation.contact_wrenches(inputs))
    }
}

impl Work {
    /// Runs the loop until it ends. The simulation is released for other calls before the end of the loop is published.
    fn run(self, told: &Told) -> Outcome<Vec<Report>> {
        let Work { lent, steps, leaders, options } = self;
        let coupling = leaders[0].tool.coupling;
        let hold = || {
            let mut object = lent.lock();
            let mut felt = Felt { object: &mut object, steps: &steps, told };
            let hear = |moment: session::Moment| {
                told.hear(moment);
                Ok(())
            };
            let reports = session::hold_each(leaders, &mut felt, &options, hear);
            object.simulation.couple(coupling);
            reports
        };
        // Unwind safety: a panic poisons the lock of the simulation, so no other call uses a half-changed simulation;
        // unwinding also stops the device.
        match catch_unwind(AssertUnwindSafe(hold)) {
            Ok(came) => came.map_err(Failure::from),
            Err(panic) => Err(Failure::of_panic(&*panic)),
        }
    }
}

impl Loop {
    fn start(self: &Arc<Self>, work: Work) -> Outcome {
        let own = Arc::clone(self);
        let work = move || {
            let came = work.run(&own.told);
            own.told.end(came);
        };
        let thread = std::thread::Builder::new().name("palpate-loop".into()).spawn(work);
        let none =
            |error| Failure::new(palpate_status::Memory, format!("the loop's thread could not be started: {error}"));
        *self.thread() = Some(thread.map_err(none)?);
        let begun = self.told.wait_for_begin();
        if begun.is_err() {
            self.join();
        }
        begun
    }

    fn thread(&self) -> std::sync::MutexGuard<'_, Option<JoinHandle<()>>> {
        self.thread.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Waits for the end of the loop's thread. A second caller waits on the lock until the first has joined the thread.
    fn join(&self) {
        let mut thread = self.thread();
        if let Some(thread) = thread.take() {
            // The result is ignored: the thread catches its panics and reports them itself.
            let _ = thread.join();
        }
    }

    /// Reads something of what is told of the tool of this index.
    fn of_tool<T>(&self, tool: u32, read: impl FnOnce(&Led) -> T) -> Outcome<T> {
        let facts = self.told.lock();
        let missing = || {
            let problem = format!("tool is {tool}, and the loop leads {} of them, counted from 0", facts.led.len());
            Failure::new(palpate_status::Argument, problem)
        };
        facts.led.get(tool as usize).map(read).ok_or_else(missing)
    }

    fn stop(&self) -> Outcome {
        self.stop.store(true, Ordering::Relaxed);
        if is_in_callback() {
            let problem = "a callback cannot wait for its own loop; the loop was asked to end: wait for it by \
                           palpate_loop_stop on another thread";
            return Err(Failure::new(palpate_status::Busy, problem));
        }
        self.join();
        Ok(())
    }
}

fn of(the_loop: *mut palpate_loop) -> Outcome<Arc<Loop>> {
    handles::beside::<LoopObject, Loop>(the_loop as usize)
}

/// Starts a haptic loop. At the loop's rate `device` is read and receives the force to play; meanwhile the simulation,
/// which must have a tool (of several the first is led), steps in real time, each step with the device's newest pose.
/// Both happen on threads of the loop. `device` and `options` are copied; `options` may be null: then all options are
/// those of the scene's `[haptics]`. The call waits for five steps, which measure how long a step takes, and for the
/// device to open; PALPATE_STATUS_NO_DEVICE: the device did not open. `the_loop` is set before the first callback is
/// called, and is set to null if no loop starts.
///
/// The loop owns the simulation until the loop has ended: calls on the simulation give PALPATE_STATUS_BUSY, except
/// `palpate_wrench_newest`, `palpate_step_poll` and `palpate_step_wait`. The simulation's handle may be destroyed while
/// the loop runs. After the loop has ended, the simulation continues from the tool, device pose and time that the loop
/// reached. Stop a loop that still runs before the program ends.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_start(
    simulation: *mut palpate_simulation,
    device: *const palpate_haptic_device,
    options: *const palpate_loop_options,
    the_loop: *mut *mut palpate_loop,
) -> palpate_status {
    guarded(|| {
        // SAFETY (all blocks): the C caller keeps the rules for pointers at the top of palpate.h.
        let the_loop = unsafe { sized::answer(the_loop, "the_loop")? };
        *the_loop = std::ptr::null_mut();
        if device.is_null() {
            return Err(Failure::new(palpate_status::Null, "device is null, but it is required"));
        }
        let (device, options) = unsafe { (sized::read(device)?, sized::read(options)?) };
        let asked = Asked { device, options, device_name: "device".into(), options_name: "options".into() };
        unsafe { start(simulation, &[asked], the_loop) }
    })
}

/// Starts a haptic loop as `palpate_loop_start` does, with a haptic device for each of the first `count` tools of the
/// scene, in the scene's order. `devices` and `options` have `count` elements; `options` may be null: then all options
/// are those of the tools' `haptics` in the scene. All devices have one clock; a fault of one leaves the forces of the
/// others as they are. `palpate_loop_read_tool` and `palpate_loop_wrench_tool` read what each does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_start_tools(
    simulation: *mut palpate_simulation,
    devices: *const palpate_haptic_device,
    options: *const palpate_loop_options,
    count: usize,
    the_loop: *mut *mut palpate_loop,
) -> palpate_status {
    guarded(|| {
        // SAFETY (all blocks): the C caller keeps the rules for pointers at the top of palpate.h.
        let the_loop = unsafe { sized::answer(the_loop, "the_loop")? };
        *the_loop = std::ptr::null_mut();
        let devices = unsafe { sized::structs(devices, count, "devices")? };
        let options = match options.is_null() {
            true => vec![palpate_loop_options::unset(); devices.len()],
            false => unsafe { sized::structs(options, count, "options")? },
        };
        let asked = |(tool, (device, options))| Asked {
            device,
            options,
            device_name: format!("devices[{tool}]"),
            options_name: format!("options[{tool}]"),
        };
        let led: Vec<_> = devices.into_iter().zip(options).enumerate().map(asked).collect();
        unsafe { start(simulation, &led, the_loop) }
    })
}

/// The device that is to lead a tool, and the options of its loop, with the names by which messages call them.
struct Asked {
    device: palpate_haptic_device,
    options: palpate_loop_options,
    device_name: String,
    options_name: String,
}

/// Starts a loop in which the devices `led` lead the first tools.
///
/// # Safety
/// The conditions of the header for a `palpate_haptic_device` hold for the devices.
unsafe fn start(simulation: *mut palpate_simulation, led: &[Asked], the_loop: &mut *mut palpate_loop) -> Outcome {
    let lent = handles::lend::<SimulationObject>(simulation as usize, HELD)?;
    let steps = steps::of(simulation)?;
    let stop = Arc::new(AtomicBool::new(false));
    let (leaders, shortest_step) = {
        let object = lent.lock();
        object.is_fit()?;
        let scene = object.simulation.scene();
        let tools: Vec<_> = object.simulation.tools().collect();
        let wrong = |status, problem: String| Err(Failure::new(status, problem));
        match (tools.len(), led.len(), scene.held_tools()) {
            (0, ..) => {
                let problem = "the scene has no tool for the haptic device; add a [tool]";
                return wrong(palpate_status::Input, problem.into());
            }
            (_, 0, _) => return wrong(palpate_status::Argument, "count is 0; give a haptic device".into()),
            (tools, count, _) if count > tools => {
                let problem = format!("count is {count}, but the scene has {tools} tools; give one device for each");
                return wrong(palpate_status::Argument, problem);
            }
            (_, count, held) if count < held => {
                let problem = format!("the scene gives haptic devices to {held} tools, but {count} would be led");
                let remedy =
                    "call palpate_loop_start_tools with a device for each, or leave `haptics` out of the others";
                return wrong(palpate_status::Input, format!("{problem}; {remedy}"));
            }
            _ => {}
        }
        let leader = |((asked, tool), given): ((&Asked, &&Tool), scene::Leader)| {
            let Asked { device, options, device_name, options_name } = asked;
            let haptics = chosen(options, options_name, &given.haptics)?;
            // SAFETY: the caller keeps the conditions under `# Safety`.
            let device = unsafe { Callbacks::new(*device, device_name, &given.haptics, &given.key)? };
            Ok(Leader { name: given.tool.into(), device: Box::new(device), tool: (*tool).clone(), haptics })
        };
        let described = (0..).map_while(|index| scene.leader(index));
        let leaders = led.iter().zip(&tools).zip(described).map(leader).collect::<Outcome<Vec<Leader>>>()?;
        (leaders, scene.step.dt)
    };
    let durations = led.iter().map(|asked| asked.options.seconds).filter(|seconds| *seconds > 0.0);
    let seconds = durations.fold(f64::INFINITY, f64::min);
    let options = Options { seconds, shortest_step, stop: stop.clone(), bare_timer: false };
    let told = Told::new(leaders.iter().map(|leader| 1.0 / leader.haptics.rate));
    let own = Arc::new(Loop { told, stop, thread: Mutex::new(None) });
    let handle = handles::insert_with(LoopObject, own.clone());
    *the_loop = handle as *mut palpate_loop;
    own.start(Work { lent, steps, leaders, options }).inspect_err(|_| {
        *the_loop = std::ptr::null_mut();
        // The result is ignored: the program has had the handle since the first callback, and may have destroyed
        // that handle already.
        let _ = handles::remove::<LoopObject>(handle);
    })
}

/// Reads the state of a loop, of several tools that of the first. This function never waits; any thread may call it at
/// any time, within callbacks too.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_read(
    the_loop: *mut palpate_loop,
    state: *mut palpate_loop_state,
) -> palpate_status {
    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
    unsafe { palpate_loop_read_tool(the_loop, 0, state) }
}

/// Reads the state of a loop for one of the tools that it leads, as `palpate_loop_read` does for the first. `tool`: its
/// position in the scene, from 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_read_tool(
    the_loop: *mut palpate_loop,
    tool: u32,
    state: *mut palpate_loop_state,
) -> palpate_status {
    guarded(|| {
        let told = of(the_loop)?.of_tool(tool, |led| led.state)?;
        if state.is_null() {
            return Err(Failure::new(palpate_status::Null, "state is null; pass the address for the answer"));
        }
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { sized::write(state, &told) }
    })
}

/// Reads the wrench of the newest step of a loop's simulation, of several tools that on the first, with the flags of
/// that step, as `palpate_wrench_newest` does. Unlike that function, this one works also after the simulation's handle
/// was destroyed. `age_seconds` receives the time since that step began, s; it may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_wrench(
    the_loop: *mut palpate_loop,
    wrench: *mut palpate_wrench,
    age_seconds: *mut f64,
) -> palpate_status {
    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
    unsafe { palpate_loop_wrench_tool(the_loop, 0, wrench, age_seconds) }
}

/// Reads the wrench of the newest step on one of the tools that a loop leads, as `palpate_loop_wrench` does on the
/// first. `tool`: its position in the scene, from 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_wrench_tool(
    the_loop: *mut palpate_loop,
    tool: u32,
    wrench: *mut palpate_wrench,
    age_seconds: *mut f64,
) -> palpate_status {
    guarded(|| {
        let newest = of(the_loop)?.of_tool(tool, |led| led.newest)?;
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { newest.tell(wrench, age_seconds) }
    })
}

/// Reads a note about a loop, one line of text. A note reports the virtual coupling that was chosen and why, a limit in
/// the options that exceeds that of the device's profile, or that a thread of the loop has no raised priority; of
/// several tools the note begins with the name of one. `note`: number of the note, from 0; `palpate_loop_state` has the
/// number of notes. `count` receives the length of the text in bytes, with its terminating zero; up to `capacity` bytes
/// are written to `text`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: the text is longer, and none
/// of it was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_note(
    the_loop: *mut palpate_loop,
    note: u32,
    text: *mut c_char,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        let own = of(the_loop)?;
        let facts = own.told.lock();
        let Some(line) = facts.notes.get(note as usize) else {
            let problem = format!("note is {note}; the loop has {} notes, counted from 0", facts.notes.len());
            return Err(Failure::new(palpate_status::Argument, problem));
        };
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { tell(line, text, capacity, count) }
    })
}

/// Reads why a loop ended, in one line; the text is "" while the loop runs. `text`, `capacity` and `count` are those of
/// `palpate_loop_note`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_ended(
    the_loop: *mut palpate_loop,
    text: *mut c_char,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        let own = of(the_loop)?;
        let facts = own.told.lock();
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { tell(&facts.ended, text, capacity, count) }
    })
}

/// Writes a line of text with a terminating zero for the caller, as `palpate_loop_note` describes it.
///
/// # Safety
/// `text` is null or has room for `capacity` bytes, and `count` is null or can be written.
unsafe fn tell(line: &str, text: *mut c_char, capacity: usize, count: *mut usize) -> Outcome {
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let count = unsafe { sized::answer(count, "count")? };
    let bytes: Vec<c_char> = line.bytes().chain([0]).map(|byte| byte as c_char).collect();
    // SAFETY: the caller keeps the conditions under `# Safety`.
    unsafe { sized::list(&bytes, text, capacity, count, "text") }
}

/// Ends a loop. When the call returns, its devices play no force and are closed, and the simulation can be used again.
/// State, notes and newest wrench of the loop can still be read. If the loop had failed, the call returns the status of
/// that failure. A call from within a callback only asks the loop to end, and gives PALPATE_STATUS_BUSY.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_loop_stop(the_loop: *mut palpate_loop) -> palpate_status {
    guarded(|| {
        let own = of(the_loop)?;
        own.stop()?;
        let failure = own.told.lock().failure.clone();
        failure.map_or(Ok(()), Err)
    })
}

/// Stops a loop as `palpate_loop_stop` does, and destroys its handle. A call from within a callback only asks the loop
/// to end, and the handle stays valid. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_loop_destroy(the_loop: *mut palpate_loop) -> palpate_status {
    guarded(|| {
        if the_loop.is_null() {
            return Ok(());
        }
        of(the_loop)?.stop()?;
        handles::remove::<LoopObject>(the_loop as usize)
    })
}
