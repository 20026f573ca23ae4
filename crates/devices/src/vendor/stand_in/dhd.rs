//! Stands in for `libdrd` of Force Dimension in tests: the same functions, without a device. Tests and library share the
//! memory `STAND_IN` (`places.rs`). Compiled by the tests as a library of its own.

#![allow(non_snake_case)]

#[path = "places.rs"]
mod places;

use std::ffi::{c_char, c_int, c_uchar, c_uint, c_ushort};
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::atomic::Ordering::SeqCst;

use places::*;

#[unsafe(no_mangle)]
pub static STAND_IN: [AtomicU64; LENGTH] = [const { AtomicU64::new(0) }; LENGTH];

/// Numbers of the device and of the second one; not zero, so that a call without them is seen.
const ID: c_char = 3;
const SECOND_ID: c_char = 4;

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
        set(TYPE, 104.0);
    }
}

fn count_up(place: usize) {
    set(place, get(place) + 1.0);
}

/// Which of the two devices are open.
static IS_OPEN: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];

/// Where the places of a device begin.
fn bank(id: c_char) -> usize {
    if id == SECOND_ID { SECOND_DEVICE } else { 0 }
}

/// Whether a call for a device may be answered: it is open, and there.
fn is_well(id: c_char) -> bool {
    let is_open = [ID, SECOND_ID].contains(&id) && IS_OPEN[usize::from(id == SECOND_ID)].load(SeqCst);
    if !is_open {
        count_up(MISUSES);
    }
    is_open && (id == SECOND_ID || get(IS_THERE) != 0.0)
}

fn answer(is_well: bool) -> c_int {
    if is_well { 0 } else { -1 }
}

fn give(place: usize, to: [*mut f64; 3]) {
    for (k, to) in to.into_iter().enumerate() {
        unsafe { *to = get(place + k) };
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetDeviceCount() -> c_int {
    begin();
    c_int::from(get(IS_THERE) != 0.0) + c_int::from(get(SECOND) != 0.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn drdOpenID(index: c_char) -> c_int {
    let count = dhdGetDeviceCount();
    if c_int::from(index) >= count {
        return -1;
    }
    let is_second = get(SECOND) != 0.0 && index == 0;
    // One that is open already gives its number again.
    if !IS_OPEN[usize::from(is_second)].swap(true, SeqCst) {
        count_up(OPENED);
    }
    c_int::from(if is_second { SECOND_ID } else { ID })
}

#[unsafe(no_mangle)]
pub extern "C" fn drdClose(id: c_char) -> c_int {
    let is_well = is_well(id);
    if IS_OPEN[usize::from(id == SECOND_ID)].swap(false, SeqCst) {
        count_up(CLOSED);
    }
    answer(is_well)
}

#[unsafe(no_mangle)]
pub extern "C" fn drdIsInitialized(id: c_char) -> bool {
    is_well(id) && get(IS_CALIBRATED) != 0.0
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdStop(id: c_char) -> c_int {
    set(bank(id) + IS_ENABLED, 0.0);
    answer(is_well(id))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdEnableForce(value: c_uchar, id: c_char) -> c_int {
    set(bank(id) + IS_ENABLED, value.into());
    answer(is_well(id))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetStatus(states: *mut c_int, id: c_char) -> c_int {
    for k in 0..17 {
        let state = match k {
            5 => c_int::from(get(bank(id) + IS_ENABLED) != 0.0 && get(IS_OFF) == 0.0),
            _ => 1,
        };
        unsafe { *states.add(k) = state };
    }
    answer(is_well(id))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetSystemType(_: c_char) -> c_int {
    get(TYPE) as c_int
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetSystemName(_: c_char) -> *const c_char {
    c"stand-in\n7".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetSerialNumber(serial: *mut c_ushort, id: c_char) -> c_int {
    unsafe { *serial = get(if id == SECOND_ID { SECOND } else { SERIAL }) as c_ushort };
    answer(is_well(id))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdHasWrist(_: c_char) -> bool {
    ![33.0, 60.0, 63.0].contains(&get(TYPE))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetPositionAndOrientationFrame(
    x: *mut f64,
    y: *mut f64,
    z: *mut f64,
    frame: *mut [[f64; 3]; 3],
    id: c_char,
) -> c_int {
    count_up(SAMPLES);
    give(bank(id) + POSITION, [x, y, z]);
    for k in 0..9 {
        unsafe { (*frame)[k / 3][k % 3] = get(bank(id) + AXES + k) };
    }
    answer(is_well(id) && get(bank(id) + ERROR) == 0.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetLinearVelocity(x: *mut f64, y: *mut f64, z: *mut f64, id: c_char) -> c_int {
    give(bank(id) + VELOCITY, [x, y, z]);
    // The library needs two positions for it.
    answer(is_well(id) && get(SAMPLES) > 1.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetAngularVelocityRad(x: *mut f64, y: *mut f64, z: *mut f64, id: c_char) -> c_int {
    give(bank(id) + ANGULAR_VELOCITY, [x, y, z]);
    answer(is_well(id))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetButtonMask(id: c_char) -> c_uint {
    get(bank(id) + BUTTONS) as c_uint
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdSetForceAndTorqueAndGripperForce(
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    e: f64,
    f: f64,
    gripper: f64,
    id: c_char,
) -> c_int {
    [a, b, c, d, e, f].into_iter().enumerate().for_each(|(k, value)| set(bank(id) + WRENCH + k, value));
    let is_force = [a, b, c, d, e, f].iter().any(|value| *value != 0.0);
    if gripper != 0.0 || is_force && get(bank(id) + IS_ENABLED) == 0.0 {
        count_up(MISUSES);
    }
    // A saturated motor is no error.
    if is_well(id) { 2 } else { -1 }
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdErrorGetLastStr() -> *const c_char {
    c"communication error".as_ptr()
}
