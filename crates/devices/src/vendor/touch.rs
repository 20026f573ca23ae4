//! Devices of 3D Systems (Touch, Touch X, Phantom) through `libHD` of OpenHaptics 3 (facts: its headers, reference and
//! guide, and the drivers of CHAI3D 3.2 and SOFA). Positions are in mm, forces in N; x points to the right, y up, z to
//! the user, as in palpate. The library's scheduler calls a function of ours about 1000 times a second; each call is a
//! *frame*, which reads the device and commands its force, or calibrates it first.

use std::ffi::{CString, c_char, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicU32};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use glam::{DMat3, DQuat, DVec3};
use palpate::RigidState;
use palpate::internal::haptics::Fault;
use palpate::scene::profile::{PREMIUM, Profile, TOUCH};

use super::library::{self, functions};
use super::{CLOSE_WAIT, Desk, Found, Library, Settings};

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

/// The library with an open device, which is released at the end.
pub struct OpenHaptics {
    functions: Functions,
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
        // SAFETY: the name is a text that ends in a zero byte, or null, which means the default device.
        let device = unsafe { (functions.init_device)(unit.as_ref().map_or(std::ptr::null(), |unit| unit.as_ptr())) };
        let found = Found { name: String::new(), profile: TOUCH, is_known: false };
        let mut library = OpenHaptics { functions, device: AtomicU32::new(device), found };
        let named = settings.unit.as_ref().map(|unit| format!(" called {unit:?}")).unwrap_or_default();
        let failed = |why: String| Fault::Lost(format!("no device{named} can be opened ({why}): {PLUG_IN}"));
        match library.error() {
            Some((_, text)) => return Err(failed(text)),
            None if device == INVALID => return Err(failed("the library gives no reason".into())),
            None => {}
        }
        library.found = library.identity();
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
        let failed = |what: &str, text: String| Err(Fault::Lost(format!("{what}: {text}")));
        // SAFETY: the library calls `frame` with the address of `shared`, which lives until `Scheduled` has seen to it
        // that it does so no more; here the scheduler does not run yet.
        let handle = unsafe {
            (f.make_current_device)(shared.library.device.load(Relaxed));
            (f.enable)(FORCE_OUTPUT);
            (f.schedule_asynchronous)(frame, data, PRIORITY)
        };
        if let Some((_, text)) = shared.library.error() {
            // SAFETY: as above.
            unsafe { (f.unschedule)(handle) };
            return failed("nothing can be scheduled with the library", text);
        }
        // SAFETY: as above.
        unsafe { (f.start_scheduler)() };
        Ok(Scheduled { shared, stop, handle })
    }
}

// SAFETY of all calls in this block: the functions are called as the library's reference says, for a device that is open;
// pointers are to variables that outlive the call and have the length that the function reads or writes.
impl OpenHaptics {
    /// The newest of the errors that the library has noted, if any, or that of warm motors if it is among them: its code
    /// and its text. The others are forgotten.
    fn error(&self) -> Option<(c_uint, String)> {
        let mut newest: Option<(c_uint, String)> = None;
        for _ in 0..MOST_ERRORS {
            let error = unsafe { (self.functions.get_error)() };
            if error.code == 0 {
                break;
            }
            if newest.is_none() || error.code == WARM_MOTORS {
                let text = unsafe { library::text((self.functions.get_error_string)(error.code)) };
                newest = Some((error.code, format!("{text}, {:#06x}, internal {}", error.code, error.internal)));
            }
        }
        newest
    }

    fn identity(&self) -> Found {
        let text = |what| unsafe { library::text((self.functions.get_string)(what)) };
        let (model, serial) = (text(MODEL), text(SERIAL_NUMBER));
        // A library that does not know one of the two notes an error.
        let _ = self.error();
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
        let force = if work.is_calibrated { desk.wrench().force.to_array() } else { [0.0; 3] };
        unsafe {
            (f.set_doublev)(FORCE, force.as_ptr());
            (f.end_frame)(device);
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

    /// Releases the device, once.
    fn disable(&self) {
        let device = self.device.swap(INVALID, Relaxed);
        if device != INVALID {
            unsafe { (self.functions.disable_device)(device) };
        }
    }
}

impl Drop for OpenHaptics {
    fn drop(&mut self) {
        self.disable();
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
    /// Waits for a frame without force, ends the scheduler, and releases the device. Where the library does not return,
    /// a thread waits for it, and nothing that it works with is freed.
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        let asked = Instant::now();
        while !self.shared.has_stopped.load(Acquire) && asked.elapsed() < CLOSE_WAIT {
            thread::sleep(Duration::from_millis(1));
        }
        let has_stopped = self.shared.has_stopped.load(Acquire);
        if !has_stopped {
            // The library may call the function later.
            std::mem::forget(self.shared.clone());
        }
        let (shared, handle) = (self.shared.clone(), self.handle);
        let (tell, told) = mpsc::channel();
        let end = move || {
            let f = &shared.library.functions;
            // SAFETY: the functions are called as the library's reference says; a function that is done is not scheduled
            // any more.
            unsafe {
                (f.stop_scheduler)();
                if !has_stopped {
                    (f.unschedule)(handle);
                }
            }
            shared.library.disable();
            let _ = tell.send(());
        };
        if thread::Builder::new().name("openhaptics-end".into()).spawn(end).is_ok() {
            let _ = told.recv_timeout(CLOSE_WAIT);
        }
    }
}
