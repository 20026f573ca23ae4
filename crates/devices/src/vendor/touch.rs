//! Devices of 3D Systems (Touch, Touch X, Phantom) through `libHD` of OpenHaptics 3 (facts: its header `hdDefines.h` and
//! the drivers of CHAI3D 3.2 and SOFA). Positions are in mm, forces in N; x points to the right, y up, z to the user, as
//! in palpate. The library's scheduler calls a function of ours some thousand times a second, in which one *frame*
//! reads the device and commands its force.

use std::ffi::{CString, c_char, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::{Arc, Mutex, PoisonError};
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
    "install OpenHaptics and the device's driver, and let the loader find libHD (Linux: LD_LIBRARY_PATH)";
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
/// Ways to calibrate, from the one that needs no hand; each is a bit of what the device supports.
const STYLES: [c_uint; 3] = [2, 4, 1];
const DONE: c_uint = 0;
const CONTINUE: c_uint = 1;
const PRIORITY: c_ushort = c_ushort::MAX;
/// Errors of a device are between these; others, such as too large a force, end by themselves.
const DEVICE_ERRORS: std::ops::Range<c_uint> = 0x0300..0x0400;
/// Greatest number of errors that are taken from the library's list in a frame.
const MOST_ERRORS: usize = 8;
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
    device: c_uint,
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
        let found = Found { name: String::new(), profile: &TOUCH, is_known: false, senses_rotation: true };
        let mut library = OpenHaptics { functions, device, found };
        let named = settings.unit.as_ref().map(|unit| format!(" called {unit:?}")).unwrap_or_default();
        let failed = |why: String| Fault::Lost(format!("no device{named} can be opened ({why}): {PLUG_IN}"));
        match library.error() {
            Some((_, text)) => return Err(failed(text)),
            None if device == INVALID => return Err(failed("the library gives no reason".into())),
            None => {}
        }
        library.calibrate()?;
        library.found = library.identity();
        Ok(library)
    }

    fn found(&self) -> Found {
        self.found.clone()
    }

    fn begin(self, desk: Desk) -> Result<Scheduled, Fault> {
        let stop = desk.stop.clone();
        let shared = Arc::new(Shared { library: self, desk: Mutex::new(desk), has_stopped: AtomicBool::new(false) });
        let f = &shared.library.functions;
        let data = Arc::as_ptr(&shared).cast_mut().cast();
        // SAFETY: the library calls `frame` with the address of `shared`, which lives until `Scheduled` has unscheduled it.
        let handle = unsafe {
            (f.make_current_device)(shared.library.device);
            (f.enable)(FORCE_OUTPUT);
            let handle = (f.schedule_asynchronous)(frame, data, PRIORITY);
            (f.start_scheduler)();
            handle
        };
        let failure = shared.library.error();
        let scheduled = Scheduled { shared, stop, handle };
        match failure {
            Some((_, text)) => Err(Fault::Lost(format!("the library's scheduler does not start: {text}"))),
            None => Ok(scheduled),
        }
    }
}

// SAFETY of all calls in this block: the functions are called as the library's reference says, for a device that is open;
// pointers are to variables that outlive the call and have the length that the function reads or writes.
impl OpenHaptics {
    /// The last of the errors that the library has noted, if any: its code and its text.
    fn error(&self) -> Option<(c_uint, String)> {
        let mut last = None;
        for _ in 0..MOST_ERRORS {
            let error = unsafe { (self.functions.get_error)() };
            if error.code == 0 {
                break;
            }
            let text = unsafe { library::text((self.functions.get_error_string)(error.code)) };
            last = Some((error.code, format!("{text}, {:#06x}, internal {}", error.code, error.internal)));
        }
        last
    }

    /// Calibrates a device that can do so by itself; asks for the hand with one that cannot.
    fn calibrate(&self) -> Result<(), Fault> {
        let f = &self.functions;
        if unsafe { (f.check_calibration)() } == CALIBRATION_NEEDS_UPDATE {
            let mut styles = 0;
            unsafe { (f.get_integerv)(CALIBRATION_STYLE, &mut styles) };
            if let Some(style) = STYLES.iter().find(|style| c_uint::try_from(styles).unwrap_or(0) & **style != 0) {
                unsafe { (f.update_calibration)(*style) };
            }
        }
        let state = unsafe { (f.check_calibration)() };
        match (self.error(), state) {
            (Some((_, text)), _) => Err(Fault::Lost(format!("the device cannot be calibrated: {text}"))),
            (None, CALIBRATION_OK) => Ok(()),
            (None, _) => Err(Fault::Lost(
                "the device is not calibrated: put its stylus into the inkwell, and start again".into(),
            )),
        }
    }

    fn identity(&self) -> Found {
        let text = |what| unsafe { library::text((self.functions.get_string)(what)) };
        let (model, serial) = (text(MODEL), text(SERIAL_NUMBER));
        let _ = self.error();
        let upper = model.to_uppercase();
        let known = KNOWN.iter().find(|(name, _)| upper.starts_with(name)).map(|(_, profile)| *profile);
        Found {
            name: format!("{model:?} (serial number {serial:?})"),
            profile: known.unwrap_or(OpenHaptics::SMALLEST),
            is_known: known.is_some(),
            senses_rotation: true,
        }
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

    /// One frame: reads the device, and commands its force.
    fn frame(&self, desk: &mut Desk) {
        unsafe { (self.functions.begin_frame)(self.device) };
        let (state, buttons) = self.sample();
        let force = desk.wrench().force.to_array();
        unsafe {
            (self.functions.set_doublev)(FORCE, force.as_ptr());
            (self.functions.end_frame)(self.device);
        }
        match self.error() {
            Some((code, text)) if DEVICE_ERRORS.contains(&code) => desk.report(Fault::Lost(text)),
            Some((_, text)) => desk.report(Fault::Lost(format!("the library plays no force: {text}"))),
            None if !state.is_valid() => desk.report(Fault::Garbled("the pose or the velocity is not finite".into())),
            None => desk.publish(state, buttons),
        }
    }
}

impl Drop for OpenHaptics {
    fn drop(&mut self) {
        if self.device != INVALID {
            // SAFETY: the device is open, and no function of ours is scheduled any more.
            unsafe { (self.functions.disable_device)(self.device) };
        }
    }
}

/// What the scheduler's thread works with.
struct Shared {
    library: OpenHaptics,
    desk: Mutex<Desk>,
    /// Set by a frame that has seen that the device is to be closed, and has commanded no force.
    has_stopped: AtomicBool,
}

/// Called by the library's scheduler.
///
/// # Safety
/// `data` is the address of a [`Shared`] that lives until the function is unscheduled.
unsafe extern "C" fn frame(data: *mut c_void) -> c_uint {
    // SAFETY: the caller's promise.
    let shared = unsafe { &*data.cast_const().cast::<Shared>() };
    let mut desk = shared.desk.lock().unwrap_or_else(PoisonError::into_inner);
    let is_stopping = desk.is_stopping();
    shared.library.frame(&mut desk);
    drop(desk);
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
    /// Waits for a frame without force, and ends the scheduler; then the device is released.
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        let asked = Instant::now();
        while !self.shared.has_stopped.load(Acquire) && asked.elapsed() < CLOSE_WAIT {
            thread::sleep(Duration::from_millis(1));
        }
        let has_stopped = self.shared.has_stopped.load(Acquire);
        let f = &self.shared.library.functions;
        // SAFETY: the functions are called as the library's reference says.
        unsafe {
            (f.stop_scheduler)();
            if !has_stopped {
                (f.unschedule)(self.handle);
            }
        }
        if !has_stopped {
            // The library hangs, and may call the function later: what that works with is never freed.
            std::mem::forget(self.shared.clone());
        }
    }
}
