//! Stands in for `libHD` of OpenHaptics in tests: the same functions, without a device. Tests and library share the
//! memory `STAND_IN` (`places.rs`). Compiled by the tests as a library of its own.

#![allow(non_snake_case)]

#[path = "places.rs"]
mod places;

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::sync::Mutex;
use std::sync::atomic::Ordering::SeqCst;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use places::*;

#[unsafe(no_mangle)]
pub static STAND_IN: [AtomicU64; LENGTH] = [const { AtomicU64::new(0) }; LENGTH];

/// Handles of the device and of the second one.
const DEVICE: c_uint = 5;
const SECOND_HANDLE: c_uint = 6;
const INVALID: c_uint = 0xffff_ffff;
const MODELS: [&CStr; 4] = [c"Touch", c"PHANTOM Premium 1.5", c"Maxitouch", c"Phantom Omni"];
/// Names of the two devices in the maker's configuration.
const NAME: &CStr = c"Left Device";
const SECOND_NAME: &CStr = c"Right Device";

#[repr(C)]
pub struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: c_uint,
}

type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

/// Errors, each with its device. The newest is last, and is told first.
static ERRORS: Mutex<Vec<(c_uint, c_uint)>> = Mutex::new(Vec::new());
/// Scheduled functions with their handles and data, and the handle that was given last.
static TASKS: Mutex<Vec<(c_ulong, Callback, usize)>> = Mutex::new(Vec::new());
static LAST_TASK: AtomicU64 = AtomicU64::new(76);
/// Which of the two devices are open.
static IS_OPEN: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];
static THREAD: Mutex<Option<JoinHandle<()>>> = Mutex::new(None);
static IS_RUNNING: AtomicBool = AtomicBool::new(false);

thread_local! {
    static IS_IN_FRAME: Cell<bool> = const { Cell::new(false) };
    static CURRENT: Cell<c_uint> = const { Cell::new(INVALID) };
}

/// Where the places of the current device begin.
fn bank() -> usize {
    if CURRENT.get() == SECOND_HANDLE { SECOND_DEVICE } else { 0 }
}

/// Whether a force is commanded to a device.
fn has_force() -> bool {
    (0..6).any(|k| get(WRENCH + k) != 0.0 || get(SECOND_DEVICE + WRENCH + k) != 0.0)
}

/// Whether a device of this handle is open.
fn is_open(device: c_uint) -> bool {
    [DEVICE, SECOND_HANDLE].contains(&device) && IS_OPEN[usize::from(device == SECOND_HANDLE)].load(SeqCst)
}

fn get(place: usize) -> f64 {
    f64::from_bits(STAND_IN[place].load(SeqCst))
}

fn set(place: usize, value: f64) {
    STAND_IN[place].store(value.to_bits(), SeqCst);
}

/// Where another process than that of the tests opens the library, there is a calibrated device.
fn begin() {
    if std::env::var_os("STAND_IN").is_some() {
        [IS_THERE, IS_CALIBRATED, SERIAL, AXES, AXES + 4, AXES + 8].into_iter().for_each(|place| set(place, 1.0));
        set(TYPE, 0.0);
    }
}

fn count(place: usize) {
    set(place, get(place) + 1.0);
}

fn fail(code: c_uint) {
    ERRORS.lock().unwrap().push((code, CURRENT.get()));
}

/// Counts a call that belongs into a frame of the running scheduler, and is not in one.
fn check_frame() {
    if !IS_IN_FRAME.get() || !IS_RUNNING.load(SeqCst) && TASKS.try_lock().is_ok() {
        count(MISUSES);
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdInitDevice(name: *const c_char) -> c_uint {
    begin();
    if IS_RUNNING.load(SeqCst) || has_force() {
        count(MISUSES);
    }
    let is_named = |own: &CStr| unsafe { CStr::from_ptr(name) } == own;
    let is_second = !name.is_null() && is_named(SECOND_NAME) && get(SECOND) != 0.0;
    if get(IS_THERE) == 0.0 || !is_second && !name.is_null() && !is_named(NAME) {
        fail(0x0302);
        return INVALID;
    }
    let device = if is_second { SECOND_HANDLE } else { DEVICE };
    CURRENT.set(device);
    if !IS_OPEN[usize::from(is_second)].swap(true, SeqCst) {
        count(OPENED);
    }
    device
}

#[unsafe(no_mangle)]
pub extern "C" fn hdDisableDevice(device: c_uint) {
    // A driver ends the scheduler before, and, unless that hangs, the force.
    let hangs = get(HANGS) != 0.0;
    let own = if device == SECOND_HANDLE { SECOND_DEVICE } else { 0 };
    // Nor may the other device keep a force while it is not called.
    if !is_open(device) || IS_RUNNING.load(SeqCst) || !hangs && has_force() {
        count(MISUSES);
    }
    set(own + IS_ENABLED, 0.0);
    if IS_OPEN[usize::from(device == SECOND_HANDLE)].swap(false, SeqCst) {
        count(CLOSED);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdMakeCurrentDevice(device: c_uint) {
    CURRENT.set(device);
    if !is_open(device) {
        fail(0x0104);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdBeginFrame(device: c_uint) {
    CURRENT.set(device);
    if !is_open(device) || IS_IN_FRAME.replace(true) {
        count(MISUSES);
    }
    count(SAMPLES);
    if get(IS_THERE) == 0.0 {
        fail(0x0302);
    }
    if get(bank() + ERROR) != 0.0 {
        fail(get(bank() + ERROR) as c_uint);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEndFrame(device: c_uint) {
    if device != CURRENT.get() || !IS_IN_FRAME.replace(false) {
        count(MISUSES);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEnable(what: c_uint) {
    match what {
        0x4000 => set(bank() + IS_ENABLED, 1.0),
        _ => fail(0x0100),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetError() -> ErrorInfo {
    let (code, device) = ERRORS.lock().unwrap().pop().unwrap_or((0, INVALID));
    ErrorInfo { code, internal: -9, device }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetErrorString(code: c_uint) -> *const c_char {
    match code {
        0x0302 => c"Communication error".as_ptr(),
        0x0201 => c"Exceeded maximum force".as_ptr(),
        _ => c"Some error".as_ptr(),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetString(what: c_uint) -> *const c_char {
    match what {
        0x2501 => MODELS[get(TYPE) as usize].as_ptr(),
        0x2504 if bank() != 0 => c"SN-99".as_ptr(),
        0x2504 if get(SERIAL) == 1.0 => c"SN-1".as_ptr(),
        0x2504 => c"SN-2".as_ptr(),
        _ => std::ptr::null(),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetIntegerv(what: c_uint, to: *mut c_int) {
    match what {
        0x2000 => unsafe { *to = get(bank() + BUTTONS) as c_int },
        0x2555 => unsafe { *to = get(STYLES) as c_int },
        _ => fail(0x0100),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetDoublev(what: c_uint, to: *mut f64) {
    check_frame();
    let put = |k: usize, value: f64| unsafe { *to.add(k) = value };
    match what {
        0x2052 => {
            // By columns, with the position in the last one.
            for (row, column) in (0..3).flat_map(|row| (0..3).map(move |column| (row, column))) {
                put(4 * column + row, get(bank() + AXES + 3 * row + column));
            }
            (0..3).for_each(|k| put(12 + k, get(bank() + POSITION + k)));
            (0..3).for_each(|k| put(4 * k + 3, 0.0));
            put(15, 1.0);
        }
        0x2051 => (0..3).for_each(|k| put(k, get(bank() + VELOCITY + k))),
        0x2053 => (0..3).for_each(|k| put(k, get(bank() + ANGULAR_VELOCITY + k))),
        _ => fail(0x0100),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdSetDoublev(what: c_uint, from: *const f64) {
    check_frame();
    match what {
        0x2700 => (0..3).for_each(|k| set(bank() + WRENCH + k, unsafe { *from.add(k) })),
        _ => fail(0x0100),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdCheckCalibration() -> c_uint {
    check_frame();
    match (get(IS_CALIBRATED) != 0.0, get(STYLES) != 0.0 && get(NEEDS_HAND) == 0.0) {
        (true, _) => 0x5000,
        (false, true) => 0x5001,
        (false, false) => 0x5002,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUpdateCalibration(style: c_uint) {
    check_frame();
    count(CALIBRATIONS);
    match style == get(STYLES) as c_uint {
        true => set(IS_CALIBRATED, 1.0),
        false => fail(0x0101),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdScheduleAsynchronous(callback: Callback, data: *mut c_void, _: c_ushort) -> c_ulong {
    if get(HANGS) == 3.0 {
        fail(0x0501);
        return 0;
    }
    let handle = LAST_TASK.fetch_add(1, SeqCst) + 1;
    TASKS.lock().unwrap().push((handle, callback, data.expose_provenance()));
    handle
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUnschedule(handle: c_ulong) {
    let mut tasks = TASKS.lock().unwrap();
    let before = tasks.len();
    tasks.retain(|(other, ..)| *other != handle);
    if get(HANGS) != 3.0 && tasks.len() == before {
        count(MISUSES);
    }
}

/// Calls a scheduled function; returns whether it is to be called again.
fn call(callback: Callback, data: usize) -> bool {
    unsafe { callback(std::ptr::with_exposed_provenance_mut(data)) != 0 }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStartScheduler() {
    if IS_RUNNING.swap(true, SeqCst) {
        count(MISUSES);
    }
    let run = || {
        while IS_RUNNING.load(SeqCst) {
            for (device, bank) in [(DEVICE, 0), (SECOND_HANDLE, SECOND_DEVICE)] {
                if get(bank + LATE_ERROR) != 0.0 {
                    ERRORS.lock().unwrap().push((get(bank + LATE_ERROR) as c_uint, device));
                }
            }
            if get(HANGS) == 0.0 {
                TASKS.lock().unwrap().retain(|(_, callback, data)| call(*callback, *data));
            }
            thread::sleep(Duration::from_micros(900));
        }
    };
    *THREAD.lock().unwrap() = Some(thread::spawn(run));
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStopScheduler() {
    if get(HANGS) == 2.0 {
        thread::sleep(Duration::from_secs(1));
    }
    while get(HANGS) == 4.0 {
        thread::sleep(Duration::from_millis(1));
    }
    IS_RUNNING.store(false, SeqCst);
    if let Some(thread) = THREAD.lock().unwrap().take() {
        let _ = thread.join();
    }
}
