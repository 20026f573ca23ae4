//! Devices of 3D Systems (Touch, Touch X, Phantom) through `libHD` of OpenHaptics 3 (facts: its headers, reference and
//! guide, and the drivers of CHAI3D 3.2 and SOFA). Positions are in mm, forces in N; x points to the right, y up, z to
//! the user, as in palpate. The library's scheduler calls a function of ours about 1000 times a second; each call is a
//! *frame*, which reads the device and commands its force, or calibrates it first.

use std::collections::BTreeMap;
use std::ffi::{CString, c_char, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicU32};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use glam::{DMat3, DQuat, DVec3};
use palpate::RigidState;
use palpate::internal::haptics::Fault;
use palpate::scene::profile::{PREMIUM, Profile, TOUCH};

use super::library::{self, functions};
use super::{CLOSE_WAIT, Desk, Found, Library, OPEN_WAIT, Settings};

/// Names under which the system's loader may find the library.
const NAMES: [&str; 4] = ["libHD.so", "libHD.so.3", "libHD.so.3.4", "hd.dll"];
const INSTALL: &str =
    "install OpenHaptics and the device's driver, and let the loader find libHD.so (Linux: LD_LIBRARY_PATH)";
const PLUG_IN: &str = "plug the device in, and set it up with the maker's Touch Setup, whose name for it is `unit`";
/// How the names of models begin, and their profiles.
const KNOWN: [(&str, &Profile); 3] = [("PHANTOM PREMIUM", &PREMIUM), ("TOUCH", &TOUCH), ("PHANTOM OMNI", &TOUCH)];

const INVALID: c_uint = 0xffff_ffff;
const BUTTONS: c_uint = 0x2000;
const VELOCITY: c_uint = 0x2051;
const TRANSFORM: c_uint = 0x2052;
const ANGULAR_VELOCITY: c_uint = 0x2053;
const MODEL: c_uint = 0x2501;
const SERIAL_NUMBER: c_uint = 0x2504;
const CALIBRATION_STYLE: c_uint = 0x2555;
const FORCE: c_uint = 0x2700;
const FORCE_OUTPUT: c_uint = 0x4000;
const CALIBRATION_OK: c_uint = 0x5000;
const CALIBRATION_NEEDS_UPDATE: c_uint = 0x5001;
/// Ways to calibrate, each a bit of what the device supports: by itself, and in its inkwell. The third, which takes the
/// present place of the arm for its neutral one, is left to the maker's program: wrong forces follow from a wrong place.
const AUTOMATIC: c_uint = 2;
const INKWELL: c_uint = 4;
/// What a scheduled function returns.
const DONE: c_uint = 0;
const CONTINUE: c_uint = 1;
const PRIORITY: c_ushort = c_ushort::MAX;
/// The error of motors that are too warm, and how long they are left to cool: shorter than the loss of a device that ends a
/// session.
const WARM_MOTORS: c_uint = 0x0200;
const COOL_DOWN: Duration = Duration::from_secs(2);
/// Longest time that closing waits for the library, of which pauses take a part.
const END_WAIT: Duration = Duration::from_millis(500);
/// For [`Hub::paused`]: there is nothing to wait for.
const AT_ONCE: fn() -> bool = || true;
/// Errors of the device itself; others tell of too large a force or speed, or of too warm a motor.
const DEVICE_ERRORS: std::ops::Range<c_uint> = 0x0300..0x0400;
/// Greatest number of errors that are taken from the library's list at a time.
const MOST_ERRORS: usize = 64;
/// Millimetres in a metre.
const MM: f64 = 1e3;

/// An error as the library gives it.
#[repr(C)]
struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: c_uint,
}

type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

functions! {
    /// Functions of the library.
    Functions {
        init_device = hdInitDevice: unsafe extern "C" fn(*const c_char) -> c_uint,
        disable_device = hdDisableDevice: unsafe extern "C" fn(c_uint),
        make_current_device = hdMakeCurrentDevice: unsafe extern "C" fn(c_uint),
        begin_frame = hdBeginFrame: unsafe extern "C" fn(c_uint),
        end_frame = hdEndFrame: unsafe extern "C" fn(c_uint),
        enable = hdEnable: unsafe extern "C" fn(c_uint),
        get_error = hdGetError: unsafe extern "C" fn() -> ErrorInfo,
        get_error_string = hdGetErrorString: unsafe extern "C" fn(c_uint) -> *const c_char,
        get_string = hdGetString: unsafe extern "C" fn(c_uint) -> *const c_char,
        get_integerv = hdGetIntegerv: unsafe extern "C" fn(c_uint, *mut c_int),
        get_doublev = hdGetDoublev: unsafe extern "C" fn(c_uint, *mut f64),
        set_doublev = hdSetDoublev: unsafe extern "C" fn(c_uint, *const f64),
        check_calibration = hdCheckCalibration: unsafe extern "C" fn() -> c_uint,
        update_calibration = hdUpdateCalibration: unsafe extern "C" fn(c_uint),
        schedule_asynchronous = hdScheduleAsynchronous: unsafe extern "C" fn(Callback, *mut c_void, c_ushort) -> c_ulong,
        unschedule = hdUnschedule: unsafe extern "C" fn(c_ulong),
        start_scheduler = hdStartScheduler: unsafe extern "C" fn(),
        stop_scheduler = hdStopScheduler: unsafe extern "C" fn(),
    }
}

/// What the devices share that a program has opened through a library.
#[derive(Default)]
struct Hub {
    /// How many functions the library's scheduler calls. It runs if there is one, and may be stopped and started, and
    /// devices opened and closed, by whoever holds this lock; its functions never do.
    scheduled: Mutex<usize>,
    /// Whether the scheduler is about to stop: its functions command no force.
    is_pausing: AtomicBool,
    noted: Mutex<Noted>,
}

#[derive(Default)]
struct Noted {
    /// The open devices by their handles.
    devices: BTreeMap<c_uint, Activity>,
    /// Errors that the library has told to the function of another device.
    errors: Vec<(c_uint, Trouble)>,
}

/// What the function of a device does.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Activity {
    Plays,
    /// It has commanded no force since a pause was asked for.
    Rests,
    /// It has commanded no force, and is not called any more.
    Ended,
}

/// Code and text of an error.
type Trouble = (c_uint, String);

impl Hub {
    /// What is shared by all devices of this library, which is never closed.
    fn of(functions: &Functions) -> Arc<Hub> {
        static HUBS: Mutex<BTreeMap<usize, Arc<Hub>>> = Mutex::new(BTreeMap::new());
        let mut hubs = HUBS.lock().unwrap_or_else(PoisonError::into_inner);
        hubs.entry(functions.init_device as usize).or_default().clone()
    }

    fn noted(&self) -> MutexGuard<'_, Noted> {
        self.noted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The lock of `scheduled`, if it is free within `patience`.
    fn lock(&self, patience: Duration) -> Result<MutexGuard<'_, usize>, Fault> {
        let asked = Instant::now();
        loop {
            match self.scheduled.try_lock() {
                Ok(scheduled) => return Ok(scheduled),
                Err(TryLockError::Poisoned(poisoned)) => return Ok(poisoned.into_inner()),
                Err(TryLockError::WouldBlock) if asked.elapsed() > patience => {
                    let why = "the library does not return from another device";
                    return Err(Fault::Lost(format!("{why}: end the program, and start it again")));
                }
                Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    /// Does something while the scheduler stands still. Before, the other devices are told to command no force, and
    /// `is_ready` is waited for; neither for longer than [`CLOSE_WAIT`].
    fn paused<R>(
        &self,
        f: &Functions,
        mut scheduled: MutexGuard<'_, usize>,
        is_ready: impl Fn() -> bool,
        work: impl FnOnce(&mut usize) -> R,
    ) -> R {
        self.is_pausing.store(true, Release);
        let asked = Instant::now();
        let resting = || self.noted().devices.values().filter(|activity| **activity != Activity::Plays).count();
        let is_done = || is_ready() && resting() >= *scheduled;
        while !is_done() && asked.elapsed() < CLOSE_WAIT {
            thread::sleep(Duration::from_millis(1));
        }
        // SAFETY (both calls): the scheduler runs where functions are scheduled, and nothing else starts or stops it.
        if *scheduled > 0 {
            unsafe { (f.stop_scheduler)() };
        }
        let done = work(&mut scheduled);
        let mut noted = self.noted();
        noted.devices.values_mut().filter(|activity| **activity == Activity::Rests).for_each(|a| *a = Activity::Plays);
        drop(noted);
        self.is_pausing.store(false, Release);
        if *scheduled > 0 {
            unsafe { (f.start_scheduler)() };
        }
        done
    }
}

/// The library with an open device, which is released at the end.
pub struct OpenHaptics {
    functions: Functions,
    hub: Arc<Hub>,
    /// Handle of the device; [`INVALID`] once it is released.
    device: AtomicU32,
    found: Found,
}

impl Library for OpenHaptics {
    type Running = Scheduled;
    const REMEDY: &'static str = PLUG_IN;
    const SMALLEST: &'static Profile = &TOUCH;

    fn open(settings: &Settings) -> Result<OpenHaptics, Fault> {
        let unit = settings.unit.as_deref().map(CString::new).transpose();
        let unit = unit.map_err(|_| Fault::Lost("the name of the device contains a zero byte".into()))?;
        let functions = Functions::of(library::open(settings.library.as_deref(), &NAMES, INSTALL)?)?;
        let hub = Hub::of(&functions);
        let found = Found { name: String::new(), profile: TOUCH, is_known: false };
        let mut library = OpenHaptics { functions, hub: hub.clone(), device: AtomicU32::new(INVALID), found };
        let named = settings.unit.as_ref().map(|unit| format!(" called {unit:?}")).unwrap_or_default();
        let failed = |why: &str| Err(Fault::Lost(format!("no device{named} can be opened ({why}): {PLUG_IN}")));
        let functions = library.functions;
        let scheduled = hub.lock(OPEN_WAIT)?;
        hub.paused(&functions, scheduled, AT_ONCE, |_| {
            library.sort_errors();
            let name = unit.as_ref().map_or(std::ptr::null(), |unit| unit.as_ptr());
            // SAFETY: the name is a text that ends in a zero byte, or null, which means the default device.
            let device = unsafe { (functions.init_device)(name) };
            let error = library.newest_error();
            if device != INVALID && hub.noted().devices.contains_key(&device) {
                let which = settings.unit.as_deref().unwrap_or("the first device");
                let remedy = "give each tool a device of its own by `unit`";
                return Err(Fault::Lost(format!("{which} is open in this program already: {remedy}")));
            }
            library.device.store(device, Relaxed);
            if let Some((_, text)) = error {
                library.disable();
                return failed(&text);
            }
            if device == INVALID {
                return failed("the library gives no reason");
            }
            hub.noted().devices.insert(device, Activity::Plays);
            library.found = library.identity();
            Ok(())
        })?;
        Ok(library)
    }

    fn found(&self) -> Found {
        self.found.clone()
    }

    fn begin(self, desk: Desk) -> Result<Scheduled, Fault> {
        let stop = desk.stop.clone();
        let work = Work { desk, is_calibrated: false };
        let shared = Arc::new(Shared { library: self, work: Mutex::new(work), has_stopped: AtomicBool::new(false) });
        let f = &shared.library.functions;
        let data = Arc::as_ptr(&shared).cast_mut().cast();
        let hub = &shared.library.hub;
        let scheduled = hub.lock(OPEN_WAIT)?;
        let handle = hub.paused(f, scheduled, AT_ONCE, |scheduled| {
            shared.library.sort_errors();
            // SAFETY: the library calls `frame` with the address of `shared`, which lives until `Scheduled` has seen to it
            // that it does so no more; here the scheduler does not run.
            let handle = unsafe {
                (f.make_current_device)(shared.library.device.load(Relaxed));
                (f.enable)(FORCE_OUTPUT);
                (f.schedule_asynchronous)(frame, data, PRIORITY)
            };
            if let Some((_, text)) = shared.library.newest_error() {
                // SAFETY: as above.
                unsafe { (f.unschedule)(handle) };
                return Err(Fault::Lost(format!("nothing can be scheduled with the library: {text}")));
            }
            *scheduled += 1;
            Ok(handle)
        })?;
        Ok(Scheduled { shared, stop, handle })
    }
}

// SAFETY of all calls in this block: the functions are called as the library's reference says, for a device that is open;
// pointers are to variables that outlive the call and have the length that the function reads or writes.
impl OpenHaptics {
    /// Takes the errors that the library has noted, the newest first, each with its device.
    fn take_errors(&self) -> Vec<(c_uint, Trouble)> {
        let mut taken = Vec::new();
        while taken.len() < MOST_ERRORS {
            let error = unsafe { (self.functions.get_error)() };
            if error.code == 0 {
                break;
            }
            let text = unsafe { library::text((self.functions.get_error_string)(error.code)) };
            let text = format!("{text}, {:#06x}, internal {}", error.code, error.internal);
            taken.push((error.device, (error.code, text)));
        }
        taken
    }

    /// While the scheduler stands still: the newest of the errors that the library has noted, if any, of whatever device
    /// it says they are. The others are forgotten.
    fn newest_error(&self) -> Option<Trouble> {
        self.take_errors().into_iter().next().map(|(_, trouble)| trouble)
    }

    /// Puts the errors that the library has noted aside for the devices that they are of.
    fn sort_errors(&self) {
        let taken = self.take_errors();
        self.hub.noted().put_aside(taken, INVALID);
    }

    /// Within the scheduler: the newest error of this device, if there is one, or that of warm motors if it is among them.
    /// Its others are forgotten; those of the other devices are put aside for them.
    fn error(&self) -> Option<Trouble> {
        let device = self.device.load(Relaxed);
        let taken = self.take_errors();
        let mut noted = self.hub.noted();
        let mut own = noted.put_aside(taken, device);
        own.extend(noted.errors.extract_if(.., |(of, _)| *of == device).map(|(_, trouble)| trouble));
        let warm = own.iter().position(|(code, _)| *code == WARM_MOTORS);
        (!own.is_empty()).then(|| own.swap_remove(warm.unwrap_or(0)))
    }

    fn identity(&self) -> Found {
        let text = |what| unsafe { library::text((self.functions.get_string)(what)) };
        let (model, serial) = (text(MODEL), text(SERIAL_NUMBER));
        // A library that does not know one of the two notes an error.
        let _ = self.take_errors();
        let upper = model.to_uppercase();
        let known = KNOWN.iter().find(|(name, _)| upper.starts_with(name)).map(|(_, profile)| *profile);
        Found {
            name: format!("{model:?} (serial number {serial:?})"),
            profile: known.unwrap_or(OpenHaptics::SMALLEST).without_torque(),
            is_known: known.is_some(),
        }
    }

    /// Within a frame: whether the device is calibrated. One that can do so by itself, or in its inkwell, is told to.
    fn calibrate(&self) -> Result<(), Fault> {
        let f = &self.functions;
        let mut styles = 0;
        let state = unsafe { (f.check_calibration)() };
        if state == CALIBRATION_OK {
            return Ok(());
        }
        unsafe { (f.get_integerv)(CALIBRATION_STYLE, &mut styles) };
        let style = [AUTOMATIC, INKWELL].into_iter().find(|style| styles.cast_unsigned() & style != 0);
        let remedy = match style {
            Some(AUTOMATIC) => "move it through its workspace",
            Some(_) => "put its stylus into the inkwell",
            None => "calibrate it with the maker's program, its arm in the neutral place",
        };
        if let (CALIBRATION_NEEDS_UPDATE, Some(style)) = (state, style) {
            unsafe { (f.update_calibration)(style) };
        }
        Err(Fault::Lost(format!("the device is not calibrated: {remedy}")))
    }

    /// Reads the device within a frame.
    fn sample(&self) -> (RigidState, u32) {
        let (mut m, mut v, mut w, mut buttons) = ([0.0; 16], [0.0; 3], [0.0; 3], 0);
        unsafe {
            (self.functions.get_doublev)(TRANSFORM, m.as_mut_ptr());
            (self.functions.get_doublev)(VELOCITY, v.as_mut_ptr());
            (self.functions.get_doublev)(ANGULAR_VELOCITY, w.as_mut_ptr());
            (self.functions.get_integerv)(BUTTONS, &mut buttons);
        }
        // The matrix is given by columns.
        let column = |k: usize| DVec3::new(m[4 * k], m[4 * k + 1], m[4 * k + 2]);
        let axes = DMat3::from_cols(column(0), column(1), column(2));
        let mut state = RigidState::at_rest(column(3) / MM, DQuat::from_mat3(&axes));
        (state.velocity, state.angular_velocity) = (DVec3::from(v) / MM, DVec3::from(w));
        (state, buttons.cast_unsigned())
    }

    /// One frame.
    fn frame(&self, work: &mut Work) {
        let (f, device, desk) = (&self.functions, self.device.load(Relaxed), &mut work.desk);
        let (mut sample, mut uncalibrated) = (None, None);
        unsafe { (f.begin_frame)(device) };
        if work.is_calibrated {
            sample = Some(self.sample());
        } else {
            match self.calibrate() {
                Ok(()) => work.is_calibrated = true,
                Err(fault) => uncalibrated = Some(fault),
            }
        }
        if sample.is_some_and(|(state, _)| !state.is_valid()) {
            desk.report(Fault::Garbled("the pose or the velocity is not finite".into()));
        }
        let is_pausing = self.hub.is_pausing.load(Acquire);
        if is_pausing && desk.is_commanded() {
            // A fault: it ends the force, which the haptic loop then lets return slowly.
            desk.report(Fault::Lost("another device of the maker is opened or closed".into()));
        }
        let may_push = work.is_calibrated && !is_pausing;
        let force = if may_push { desk.wrench().force.to_array() } else { [0.0; 3] };
        unsafe {
            (f.set_doublev)(FORCE, force.as_ptr());
            (f.end_frame)(device);
        }
        if is_pausing {
            self.hub.noted().devices.insert(device, Activity::Rests);
        }
        match self.error() {
            error if uncalibrated.is_some() => {
                let more = error.map(|(_, text)| format!(" ({text})")).unwrap_or_default();
                let Some(Fault::Lost(why) | Fault::Garbled(why)) = uncalibrated else { return };
                desk.report(Fault::Lost(why + &more));
            }
            Some((code, text)) if DEVICE_ERRORS.contains(&code) => desk.report(Fault::Lost(text)),
            Some((WARM_MOTORS, text)) => {
                desk.report_for(
                    COOL_DOWN,
                    Fault::Lost(format!("its motors are warm, and play nothing for 2 s: {text}")),
                );
            }
            Some((_, text)) => desk.report(Fault::Lost(format!("the library refuses the force: {text}"))),
            None => {
                if let Some((state, buttons)) = sample.filter(|(state, _)| state.is_valid()) {
                    desk.publish(state, buttons);
                }
            }
        }
    }

    /// While the scheduler stands still: releases the device, once.
    fn disable(&self) {
        let device = self.device.swap(INVALID, Relaxed);
        if device != INVALID {
            unsafe { (self.functions.disable_device)(device) };
            let mut noted = self.hub.noted();
            noted.devices.remove(&device);
            noted.errors.retain(|(of, _)| *of != device);
        }
    }
}

impl Noted {
    /// Keeps the errors of other open devices than `device` for them, and returns the rest.
    fn put_aside(&mut self, taken: Vec<(c_uint, Trouble)>, device: c_uint) -> Vec<Trouble> {
        let is_of_other = |of: &c_uint| *of != device && self.devices.contains_key(of);
        let (others, rest): (Vec<_>, Vec<_>) = taken.into_iter().partition(|(of, _)| is_of_other(of));
        self.errors.extend(others);
        rest.into_iter().map(|(_, trouble)| trouble).collect()
    }
}

impl Drop for OpenHaptics {
    fn drop(&mut self) {
        // Where the library does not return, the device stays open.
        if self.device.load(Relaxed) != INVALID
            && let Ok(scheduled) = self.hub.lock(CLOSE_WAIT)
        {
            self.hub.paused(&self.functions, scheduled, AT_ONCE, |_| self.disable());
        }
    }
}

/// What the scheduler's thread works with.
struct Shared {
    library: OpenHaptics,
    work: Mutex<Work>,
    /// Set by a frame that has seen that the device is to be closed, and has commanded no force.
    has_stopped: AtomicBool,
}

struct Work {
    desk: Desk,
    is_calibrated: bool,
}

/// Called by the library's scheduler.
///
/// # Safety
/// `data` is the address of a [`Shared`] that lives until this function has returned [`DONE`], or is called no more.
unsafe extern "C" fn frame(data: *mut c_void) -> c_uint {
    // SAFETY: the caller's promise.
    let shared = unsafe { &*data.cast_const().cast::<Shared>() };
    let mut work = shared.work.lock().unwrap_or_else(PoisonError::into_inner);
    let is_stopping = work.desk.is_stopping();
    shared.library.frame(&mut work);
    drop(work);
    if !is_stopping {
        return CONTINUE;
    }
    shared.library.hub.noted().devices.insert(shared.library.device.load(Relaxed), Activity::Ended);
    // Nothing may touch `shared` after this, since it may end at once; the library does not call a function again that
    // has said it is done.
    shared.has_stopped.store(true, Release);
    DONE
}

/// The scheduled function.
pub struct Scheduled {
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
    handle: c_ulong,
}

impl Drop for Scheduled {
    /// Waits for a frame without force, and releases the device while the scheduler stands still. Where the library does
    /// not return, a thread waits for it, and nothing that it works with is freed.
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        let (shared, handle) = (self.shared.clone(), self.handle);
        let (tell, told) = mpsc::channel();
        let end = move || {
            let OpenHaptics { functions, hub, .. } = &shared.library;
            let scheduled = hub.scheduled.lock().unwrap_or_else(PoisonError::into_inner);
            let has_stopped = || shared.has_stopped.load(Acquire);
            hub.paused(functions, scheduled, has_stopped, |scheduled| {
                if !has_stopped() {
                    // The library may call the function later.
                    std::mem::forget(shared.clone());
                    // SAFETY: the function is called as the library's reference says; a function that is done is not
                    // scheduled any more.
                    unsafe { (functions.unschedule)(handle) };
                }
                *scheduled -= 1;
                shared.library.disable();
            });
            let _ = tell.send(());
        };
        match thread::Builder::new().name("openhaptics-end".into()).spawn(end) {
            Ok(_) => drop(told.recv_timeout(END_WAIT)),
            // The function is still scheduled.
            Err(_) => std::mem::forget(self.shared.clone()),
        }
    }
}
