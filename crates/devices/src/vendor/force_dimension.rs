//! Devices of Force Dimension through `libdrd` of its SDK, which contains `libdhd` (facts: the SDK's reference, as the
//! documentation of `forcedimension_core` for Python gives it, and the drivers and the header of CHAI3D 3.2). Positions
//! are in m, forces in N; x points to the user, y to the right, z up. A thread of ours samples the device; each call
//! waits for the device's USB interface, some tenths of a millisecond.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{c_char, c_int, c_uchar, c_uint, c_ushort};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError};
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
const NAMES: [&str; 3] = ["libdrd.so.3", "libdrd.so", "drd64.dll"];
const INSTALL: &str = "install Force Dimension's SDK, and let the loader find its libdrd as libdrd.so.3 (a link to the \
                       SDK's file, in a folder of LD_LIBRARY_PATH)";
const PLUG_IN: &str = "plug the device in and switch it on; on Linux, its USB device must be readable and writable";
/// Numbers of device types, their profiles, and whether their wrists play torque. A sigma.3, lambda.3 and lambda.7 get the
/// limits of a sigma.7, a delta.3 those of a delta.6.
const KNOWN: [(&[c_int], &Profile, bool); 6] = [
    (&[33, 34, 35, 36, 37], &OMEGA, false),
    (&[63], &DELTA, false),
    (&[64], &DELTA, true),
    (&[206, 203], &SIGMA, false),
    (&[104, 105, 108, 109], &SIGMA, true),
    (&[60], &FALCON, false),
];
/// Place, in the list of a device's states, of whether its forces are on.
const FORCE: usize = 5;
/// Length of the list that is handed out; versions up to 3.17 of the SDK write 17 numbers at most.
const STATES: usize = 64;
/// Time from one look at the states to the next.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time between two samples: the SDK derives velocities from positions of the last 20 ms.
const LONGEST_PERIOD: Duration = Duration::from_millis(2);
/// Number of samples that fail one after the other before the device is closed and looked for again, and the pause
/// before that.
const MOST_FAILURES: u32 = 10;
const PAUSE: Duration = Duration::from_millis(500);
/// Most devices that are looked at.
const MOST_DEVICES: c_int = 16;

/// A vector in the device's axes, turned into palpate's: x to the right, y up, z to the user.
fn from_device(v: DVec3) -> DVec3 {
    DVec3::new(v.y, v.z, v.x)
}

/// The inverse of [`from_device`].
fn to_device(v: DVec3) -> DVec3 {
    DVec3::new(v.z, v.x, v.y)
}

type Frame = [[f64; 3]; 3];

/// Numbers of the devices that the program has open, by library; a library is never closed. Who looks for a device holds
/// the lock.
static OPEN: Mutex<BTreeMap<usize, BTreeSet<c_char>>> = Mutex::new(BTreeMap::new());

functions! {
    /// Functions of the SDK. The last argument of most is the number of the device.
    Functions {
        device_count = dhdGetDeviceCount: unsafe extern "C" fn() -> c_int,
        open = drdOpenID: unsafe extern "C" fn(c_char) -> c_int,
        close = drdClose: unsafe extern "C" fn(c_char) -> c_int,
        is_initialized = drdIsInitialized: unsafe extern "C" fn(c_char) -> bool,
        stop = dhdStop: unsafe extern "C" fn(c_char) -> c_int,
        enable_force = dhdEnableForce: unsafe extern "C" fn(c_uchar, c_char) -> c_int,
        get_status = dhdGetStatus: unsafe extern "C" fn(*mut c_int, c_char) -> c_int,
        get_system_type = dhdGetSystemType: unsafe extern "C" fn(c_char) -> c_int,
        get_system_name = dhdGetSystemName: unsafe extern "C" fn(c_char) -> *const c_char,
        get_serial_number = dhdGetSerialNumber: unsafe extern "C" fn(*mut c_ushort, c_char) -> c_int,
        has_wrist = dhdHasWrist: unsafe extern "C" fn(c_char) -> bool,
        get_position_and_frame = dhdGetPositionAndOrientationFrame:
            unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, *mut Frame, c_char) -> c_int,
        get_linear_velocity = dhdGetLinearVelocity:
            unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, c_char) -> c_int,
        get_angular_velocity = dhdGetAngularVelocityRad:
            unsafe extern "C" fn(*mut f64, *mut f64, *mut f64, c_char) -> c_int,
        get_button_mask = dhdGetButtonMask: unsafe extern "C" fn(c_char) -> c_uint,
        set_wrench = dhdSetForceAndTorqueAndGripperForce:
            unsafe extern "C" fn(f64, f64, f64, f64, f64, f64, f64, c_char) -> c_int,
        last_error = dhdErrorGetLastStr: unsafe extern "C" fn() -> *const c_char,
    }
}

/// The library with an open device, which is closed at the end.
pub struct Dhd {
    functions: Functions,
    /// Number of the open device in the library; `None` while it is lost.
    id: Option<c_char>,
    /// Its serial number, if the library tells one.
    serial: Option<c_ushort>,
    found: Found,
}

impl Library for Dhd {
    type Running = Thread;
    const REMEDY: &'static str = PLUG_IN;
    const SMALLEST: &'static Profile = &FALCON;

    fn open(settings: &Settings) -> Result<Dhd, Fault> {
        let number = |unit: &String| {
            let wrong = |_| Fault::Lost(format!("{unit:?} is no serial number: give one such as \"12345\""));
            unit.trim().parse::<c_ushort>().map_err(wrong)
        };
        let wanted = settings.unit.as_ref().map(number).transpose()?;
        let functions = Functions::of(library::open(settings.library.as_deref(), &NAMES, INSTALL)?)?;
        let found = Found { name: String::new(), profile: FALCON, is_known: false };
        let mut dhd = Dhd { functions, id: None, serial: None, found };
        dhd.connect(wanted)?;
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
    /// Opens the device of this serial number, or the first one that the program has not open; it must be calibrated.
    fn connect(&mut self, wanted: Option<c_ushort>) -> Result<(), Fault> {
        let f = &self.functions;
        let mut all = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        let open = all.entry(self.key()).or_default();
        let before = open.len();
        let count = unsafe { (f.device_count)() }.clamp(0, MOST_DEVICES);
        for index in 0..count {
            let index = c_char::try_from(index).unwrap_or_default();
            let opened = unsafe { (f.open)(index) };
            // The library gives the number of a device again that is open already.
            let is_new = |id: &c_char| opened >= 0 && !open.contains(id);
            let Some(id) = c_char::try_from(opened).ok().filter(is_new) else { continue };
            let mut serial = 0;
            let is_read = unsafe { (f.get_serial_number)(&mut serial, id) } >= 0;
            if wanted.is_none_or(|wanted| is_read && wanted == serial) {
                (self.id, self.serial) = (Some(id), is_read.then_some(serial));
                open.insert(id);
                break;
            }
            unsafe { (f.close)(id) };
        }
        drop(all);
        let Some(id) = self.id else {
            let named = wanted.map(|serial| format!(" of serial number {serial}")).unwrap_or_default();
            let found = format!("among {count} devices of Force Dimension none{named} can be opened");
            let more = if before > 0 { format!(", and {before} open in this program already") } else { String::new() };
            return Err(Fault::Lost(format!("{found} ({}{more}): {PLUG_IN}", self.error())));
        };
        if unsafe { (self.functions.is_initialized)(id) } {
            return Ok(());
        }
        self.release();
        Err(Fault::Lost("the device is not calibrated: run Force Dimension's Haptic Init, or calibrate by hand".into()))
    }

    /// Which library this is, among those of the program.
    fn key(&self) -> usize {
        self.functions.open as usize
    }

    /// The number of the device, while it is open.
    fn id(&self) -> Result<c_char, Fault> {
        self.id.ok_or_else(|| Fault::Lost("the device is not open".into()))
    }

    fn identity(&self) -> Found {
        let (f, id) = (&self.functions, self.id.unwrap_or_default());
        let kind = unsafe { (f.get_system_type)(id) };
        let name = unsafe { library::text((f.get_system_name)(id)) };
        let known = KNOWN.iter().find(|(kinds, ..)| kinds.contains(&kind));
        let profile = match known {
            Some((_, profile, true)) => (*profile).clone(),
            Some((_, profile, false)) => profile.without_torque(),
            None => Dhd::SMALLEST.clone(),
        };
        let senses_rotation = unsafe { (f.has_wrist)(id) };
        let serial = self.serial.map_or("without a serial number".into(), |serial| format!("serial number {serial}"));
        Found {
            name: format!("{name:?} ({serial})"),
            profile: Profile { senses_rotation, ..profile },
            is_known: known.is_some(),
        }
    }

    /// The library's text for its last error.
    fn error(&self) -> String {
        unsafe { library::text((self.functions.last_error)()) }
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
            let ended = if self.id.is_none() { self.reconnect() } else { self.ticks(&mut desk) };
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

    /// Opens the same device again.
    fn reconnect(&mut self) -> Result<(), Fault> {
        self.connect(self.serial)?;
        let now = self.identity();
        if now == self.found {
            return Ok(());
        }
        let (before, now) = (&self.found.name, now.name);
        Err(Fault::Lost(format!("the library found {before} before, and now {now}: end the session and begin another")))
    }

    fn ticks(&mut self, desk: &mut Desk) -> Result<(), Fault> {
        let id = self.id()?;
        let period = desk.period.min(LONGEST_PERIOD);
        let (mut due, mut looked) = (Instant::now(), Instant::now());
        let (mut failures, mut is_on) = (0, false);
        while !desk.is_stopping() {
            match self.sample(id) {
                Ok((state, buttons)) if state.is_valid() => {
                    failures = 0;
                    desk.publish(state, buttons);
                }
                Ok(_) => desk.report(Fault::Garbled("the pose or the velocity is not finite".into())),
                Err(fault) => {
                    failures += 1;
                    if failures >= MOST_FAILURES {
                        return Err(fault);
                    }
                    desk.report(fault);
                }
            }
            // Nothing moves the handle, not even the SDK's gravity compensation, before the haptic loop commands it.
            if !is_on && desk.is_commanded() {
                self.play(id, Wrench::ZERO)?;
                self.well(unsafe { (self.functions.enable_force)(1, id) })?;
                is_on = true;
            }
            if is_on && let Err(fault) = self.command(id, desk, &mut looked) {
                failures += 1;
                if failures >= MOST_FAILURES {
                    return Err(fault);
                }
                desk.report(fault);
            }
            due = (due + period).max(Instant::now());
            thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }

    /// Commands the newest wrench, and looks from time to time whether the device's forces are on.
    fn command(&self, id: c_char, desk: &mut Desk, looked: &mut Instant) -> Result<(), Fault> {
        if looked.elapsed() >= LOOK {
            *looked = Instant::now();
            if !self.has_force(id)? {
                let why = "its forces are off: press its force button, and mind its limit of speed";
                desk.report(Fault::Lost(why.into()));
            }
        }
        self.play(id, desk.wrench())
    }

    /// Whether the device's forces are on; its button, too great a speed and a silence of the computer switch them off.
    fn has_force(&self, id: c_char) -> Result<bool, Fault> {
        let mut states = [0; STATES];
        self.well(unsafe { (self.functions.get_status)(states.as_mut_ptr(), id) })?;
        Ok(states[FORCE] != 0)
    }

    fn sample(&self, id: c_char) -> Result<(RigidState, u32), Fault> {
        let f = &self.functions;
        let (mut p, mut v, mut w, mut frame) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, Frame::default());
        self.well(unsafe { (f.get_position_and_frame)(&mut p.x, &mut p.y, &mut p.z, &mut frame, id) })?;
        // Velocities fail where the library has too few positions yet; then they count as zero.
        if unsafe { (f.get_linear_velocity)(&mut v.x, &mut v.y, &mut v.z, id) } < 0 {
            v = DVec3::ZERO;
        }
        let mut orientation = DQuat::IDENTITY;
        if self.found.profile.senses_rotation {
            if unsafe { (f.get_angular_velocity)(&mut w.x, &mut w.y, &mut w.z, id) } < 0 {
                w = DVec3::ZERO;
            }
            // The frame is given by rows; its columns are the handle's axes in the device's.
            let axes = DMat3::from_cols_array_2d(&frame).transpose();
            let turned = |axis: DVec3| from_device(axes * to_device(axis));
            let axes = DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z));
            orientation = DQuat::from_mat3(&axes);
        }
        let buttons = unsafe { (f.get_button_mask)(id) };
        let mut state = RigidState::at_rest(from_device(p), orientation);
        (state.velocity, state.angular_velocity) = (from_device(v), from_device(w));
        Ok((state, buttons))
    }

    /// Commands a wrench. Where motors saturate the library returns a positive number, and keeps the direction.
    fn play(&self, id: c_char, wrench: Wrench) -> Result<(), Fault> {
        let [a, b, c] = to_device(wrench.force).to_array();
        let [d, e, f] = to_device(wrench.torque).to_array();
        self.well(unsafe { (self.functions.set_wrench)(a, b, c, d, e, f, 0.0, id) })
    }

    /// Commands no force, and closes the device; where that fails, nothing more can be done.
    fn release(&mut self) {
        if let Some(id) = self.id.take() {
            let _ = self.play(id, Wrench::ZERO);
            unsafe { (self.functions.stop)(id) };
            let mut all = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
            unsafe { (self.functions.close)(id) };
            all.entry(self.key()).or_default().remove(&id);
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
