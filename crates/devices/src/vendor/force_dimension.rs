//! Devices of Force Dimension through `libdhd` of its SDK, version 3.6 or later (facts: the SDK's reference, as the
//! documentation of `forcedimension_core` for Python gives it, and the drivers of CHAI3D 3.2). Positions are in m,
//! forces in N; x points to the user, y to the right, z up. A thread of ours samples the device; each call waits for the
//! device's USB interface, some tenths of a millisecond.

use std::ffi::{c_char, c_int, c_uchar, c_uint, c_ushort};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::haptics::Fault;
use palpate::internal::haptics::servo_thread::raise_priority;
use palpate::scene::profile::{DELTA, FALCON, OMEGA, Profile, SIGMA};
use palpate::{RigidState, Wrench};

use super::library::{self, functions};
use super::{CLOSE_WAIT, Desk, Found, Library, Settings};

/// Names under which the system's loader may find the library.
const NAMES: [&str; 3] = ["libdhd.so.3", "libdhd.so", "dhd64.dll"];
const INSTALL: &str = "install Force Dimension's SDK, and let the loader find its libdhd (Linux: LD_LIBRARY_PATH)";
const PLUG_IN: &str = "plug the device in and switch it on; on Linux, its USB device must be readable and writable";
/// Numbers of device types, their profiles, and whether they have a wrist that senses rotation. A lambda gets the limits
/// of a sigma.7, which are lower.
const KNOWN: [(&[c_int], &Profile); 4] =
    [(&[33, 34, 35, 36, 37], &OMEGA), (&[63], &DELTA), (&[104, 105, 206, 108, 109, 203], &SIGMA), (&[60], &FALCON)];
/// Places in the list of a device's states: whether it is connected, and whether it has been calibrated.
const CONNECTED: usize = 1;
const CALIBRATED: usize = 3;
/// Length of the list that is handed out; versions up to 3.17 of the SDK write 17 numbers at most.
const STATES: usize = 64;
/// Pause before a device that was lost is looked for again.
const PAUSE: Duration = Duration::from_millis(500);

/// A position in the device's axes, turned into palpate's: x to the right, y up, z to the user.
fn from_device(v: DVec3) -> DVec3 {
    DVec3::new(v.y, v.z, v.x)
}

/// The inverse of [`from_device`].
fn to_device(v: DVec3) -> DVec3 {
    DVec3::new(v.z, v.x, v.y)
}

type Frame = [[f64; 3]; 3];

functions! {
    /// Functions of the SDK. The last argument of most is the number of the device.
    Functions {
        open = dhdOpen: unsafe extern "C" fn() -> c_int,
        open_serial = dhdOpenSerial: unsafe extern "C" fn(c_int) -> c_int,
        close = dhdClose: unsafe extern "C" fn(c_char) -> c_int,
        stop = dhdStop: unsafe extern "C" fn(c_char) -> c_int,
        enable_force = dhdEnableForce: unsafe extern "C" fn(c_uchar, c_char) -> c_int,
        get_status = dhdGetStatus: unsafe extern "C" fn(*mut c_int, c_char) -> c_int,
        get_system_type = dhdGetSystemType: unsafe extern "C" fn(c_char) -> c_int,
        get_system_name = dhdGetSystemName: unsafe extern "C" fn(c_char) -> *const c_char,
        get_serial_number = dhdGetSerialNumber: unsafe extern "C" fn(*mut c_ushort, c_char) -> c_int,
        has_wrist = dhdHasWrist: unsafe extern "C" fn(c_char) -> bool,
        get_position_and_orientation_frame = dhdGetPositionAndOrientationFrame:
            unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, *mut Frame, c_char) -> c_int,
        get_linear_velocity = dhdGetLinearVelocity: unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, c_char) -> c_int,
        get_angular_velocity_rad = dhdGetAngularVelocityRad: unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, c_char) -> c_int,
        get_button_mask = dhdGetButtonMask: unsafe extern "C" fn(c_char) -> c_uint,
        set_force_and_torque_and_gripper_force = dhdSetForceAndTorqueAndGripperForce:
            unsafe extern "C" fn(f64, f64, f64, f64, f64, f64, f64, c_char) -> c_int,
        error_get_last_str = dhdErrorGetLastStr: unsafe extern "C" fn() -> *const c_char,
    }
}

/// The library with an open device, which is closed at the end.
pub struct Dhd {
    functions: Functions,
    serial: Option<c_int>,
    id: c_char,
    found: Found,
}

impl Library for Dhd {
    type Running = Thread;
    const REMEDY: &'static str = PLUG_IN;
    const SMALLEST: &'static Profile = &FALCON;

    fn open(settings: &Settings) -> Result<Dhd, Fault> {
        let number = |unit: &String| {
            let wrong = |_| Fault::Lost(format!("{unit:?} is no serial number: give one such as \"12345\""));
            unit.trim().parse::<c_int>().map_err(wrong)
        };
        let serial = settings.unit.as_ref().map(number).transpose()?;
        let functions = Functions::of(library::open(settings.library.as_deref(), &NAMES, INSTALL)?)?;
        let found = Found { name: String::new(), profile: &FALCON, is_known: false, senses_rotation: false };
        let mut dhd = Dhd { functions, serial, id: -1, found };
        dhd.connect()?;
        dhd.found = dhd.identity();
        Ok(dhd)
    }

    fn found(&self) -> Found {
        self.found.clone()
    }

    fn begin(self, desk: Desk) -> Result<Thread, Fault> {
        let stop = desk.stop.clone();
        let spawned = thread::Builder::new().name("force-dimension".into()).spawn(move || self.run(desk));
        let handle = spawned.map_err(|e| Fault::Lost(format!("the device's thread cannot be started: {e}")))?;
        Ok(Thread { stop, handle })
    }
}

// SAFETY of all calls in this block: the functions are called as the SDK documents them, with the number of a device that
// is open; pointers are to variables that outlive the call and have the length that the function writes.
impl Dhd {
    /// Opens the device, which must be calibrated.
    fn connect(&mut self) -> Result<(), Fault> {
        let f = &self.functions;
        let id = match self.serial {
            Some(serial) => unsafe { (f.open_serial)(serial) },
            None => unsafe { (f.open)() },
        };
        let named = self.serial.map(|serial| format!(" of serial number {serial}")).unwrap_or_default();
        self.id = c_char::try_from(id).ok().filter(|id| *id >= 0).ok_or_else(|| {
            Fault::Lost(format!("no device{named} of Force Dimension can be opened ({}): {PLUG_IN}", self.error()))
        })?;
        match self.is_calibrated() {
            Ok(true) => Ok(()),
            Ok(false) => {
                self.release();
                let remedy = "move it through its workspace as its manual says, or run Force Dimension's Haptic Init";
                Err(Fault::Lost(format!("the device is not calibrated: {remedy}")))
            }
            Err(fault) => {
                self.release();
                Err(fault)
            }
        }
    }

    fn is_calibrated(&self) -> Result<bool, Fault> {
        let mut states = [0; STATES];
        let done = unsafe { (self.functions.get_status)(states.as_mut_ptr(), self.id) };
        self.well(done)?;
        if states[CONNECTED] == 0 {
            return Err(Fault::Lost("the device is not connected".into()));
        }
        Ok(states[CALIBRATED] != 0)
    }

    fn identity(&self) -> Found {
        let f = &self.functions;
        let kind = unsafe { (f.get_system_type)(self.id) };
        let name = unsafe { library::text((f.get_system_name)(self.id)) };
        let mut serial = 0;
        let has_serial = unsafe { (f.get_serial_number)(&mut serial, self.id) } >= 0;
        let serial = if has_serial { format!(" (serial number {serial})") } else { String::new() };
        let known = KNOWN.iter().find(|(kinds, _)| kinds.contains(&kind)).map(|(_, profile)| *profile);
        let has_wrist = unsafe { (f.has_wrist)(self.id) };
        Found {
            name: format!("{name:?}{serial}"),
            profile: known.unwrap_or(Dhd::SMALLEST),
            is_known: known.is_some(),
            senses_rotation: has_wrist,
        }
    }

    /// The library's text for its last error.
    fn error(&self) -> String {
        unsafe { library::text((self.functions.error_get_last_str)()) }
    }

    /// The fault of a call that returned a negative number.
    fn well(&self, returned: c_int) -> Result<(), Fault> {
        if returned >= 0 { Ok(()) } else { Err(Fault::Lost(format!("the library says: {}", self.error()))) }
    }

    /// Samples the device until it is to be closed, and looks for it again where it is lost.
    fn run(mut self, mut desk: Desk) {
        // A failure is ignored here: the haptic loop asks for the same priority and tells the user if it is not
        // permitted.
        let _ = raise_priority();
        while !desk.is_stopping() {
            let ended = if self.id < 0 { self.reconnect() } else { self.ticks(&mut desk) };
            if let Err(fault) = ended {
                desk.report(fault);
                self.release();
                let lost = Instant::now();
                while lost.elapsed() < PAUSE && !desk.is_stopping() {
                    thread::sleep(Duration::from_millis(5));
                }
            }
        }
    }

    /// Opens the device again; any other is refused.
    fn reconnect(&mut self) -> Result<(), Fault> {
        self.connect()?;
        let now = self.identity();
        if now == self.found {
            return Ok(());
        }
        let (before, now) = (&self.found.name, now.name);
        Err(Fault::Lost(format!("the library found {before} before, and now {now}: end the session and begin another")))
    }

    fn ticks(&mut self, desk: &mut Desk) -> Result<(), Fault> {
        // Without force in the first tick: what was commanded before the device was lost is not meant for it any more.
        self.play(Wrench::ZERO)?;
        self.well(unsafe { (self.functions.enable_force)(1, self.id) })?;
        let mut due = Instant::now();
        while !desk.is_stopping() {
            let (state, buttons) = self.sample()?;
            match state.is_valid() {
                true => desk.publish(state, buttons),
                false => desk.report(Fault::Garbled("the pose or the velocity is not finite".into())),
            }
            self.play(desk.wrench())?;
            due = (due + desk.period).max(Instant::now());
            thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }

    fn sample(&self) -> Result<(RigidState, u32), Fault> {
        let f = &self.functions;
        let (mut p, mut v, mut w, mut frame) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, Frame::default());
        self.well(unsafe {
            (f.get_position_and_orientation_frame)(&mut p.x, &mut p.y, &mut p.z, &mut frame, self.id)
        })?;
        self.well(unsafe { (f.get_linear_velocity)(&mut v.x, &mut v.y, &mut v.z, self.id) })?;
        let mut orientation = DQuat::IDENTITY;
        if self.found.senses_rotation {
            self.well(unsafe { (f.get_angular_velocity_rad)(&mut w.x, &mut w.y, &mut w.z, self.id) })?;
            // The frame is given by rows; its columns are the handle's axes in the device's.
            let axes = DMat3::from_cols_array_2d(&frame).transpose();
            let turned = |axis: DVec3| from_device(axes * to_device(axis));
            let axes = DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z));
            orientation = DQuat::from_mat3(&axes);
        }
        let buttons = unsafe { (f.get_button_mask)(self.id) };
        let mut state = RigidState::at_rest(from_device(p), orientation);
        (state.velocity, state.angular_velocity) = (from_device(v), from_device(w));
        Ok((state, buttons))
    }

    /// Commands a wrench. Where motors saturate the library returns a positive number, and keeps the direction.
    fn play(&self, wrench: Wrench) -> Result<(), Fault> {
        let (force, torque) = (to_device(wrench.force), to_device(wrench.torque));
        let [a, b, c] = force.to_array();
        let [d, e, f] = torque.to_array();
        self.well(unsafe { (self.functions.set_force_and_torque_and_gripper_force)(a, b, c, d, e, f, 0.0, self.id) })
    }

    /// Commands no force, and closes the device; where that fails, nothing more can be done.
    fn release(&mut self) {
        if self.id >= 0 {
            let _ = self.play(Wrench::ZERO);
            unsafe {
                (self.functions.stop)(self.id);
                (self.functions.close)(self.id);
            }
            self.id = -1;
        }
    }
}

impl Drop for Dhd {
    fn drop(&mut self) {
        self.release();
    }
}

/// The thread that samples the device.
pub struct Thread {
    stop: Arc<AtomicBool>,
    handle: JoinHandle<()>,
}

impl Drop for Thread {
    /// Waits until the device is released; a thread that the library keeps longer ends by itself later.
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        let asked = Instant::now();
        while !self.handle.is_finished() && asked.elapsed() < CLOSE_WAIT {
            thread::sleep(Duration::from_millis(1));
        }
    }
}
