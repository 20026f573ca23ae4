//! A SpaceMouse of 3Dconnexion, or another device that the USB HID standard calls a multi-axis controller, as a haptic
//! device of six degrees of freedom that plays no force. Its cap sets the velocity of a goal, which the device follows as
//! [`Mouse`] follows one: as long as the cap is pushed, the tool moves. Known by descriptions of its protocol only: nobody
//! has met a real one with this code.
//!
//! A report is one byte that tells its kind, then little-endian numbers: 1, translation, three of 16 bits, to which newer
//! models add the rotation; 2, rotation, likewise; 3, buttons, one bit each. The cap's axes are right, towards the user and
//! down. A thread reads reports, so that the haptic loop never waits for the device.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU32};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use glam::{DQuat, DVec3};
#[cfg(target_os = "linux")]
use hidapi::{DeviceInfo, HidApi};
use palpate::Wrench;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::scene::Profile;

use crate::mouse::{CATCH_UP, Goal, Mouse};

/// Usage page (generic desktop) and usage (multi-axis controller) of such a device in the HID standard.
#[cfg(target_os = "linux")]
const USAGE: (u16, u16) = (1, 8);
/// What a cap that is pushed as far as it goes reports.
const FULL: f64 = 350.0;
/// Share of `FULL` below which the cap counts as released.
const DEAD: f64 = 0.04;
/// Speed (m/s) and angular speed (rad/s) of the goal while the cap is pushed as far as it goes. They grow as the square of
/// the push, so that small pushes move finely.
const SPEEDS: [f64; 2] = [0.1, 1.5];
/// How long the thread waits for a report before it looks whether it should end, and for a lost device to be back.
const WAIT: Duration = Duration::from_millis(100);

/// Waits for a report for at most the given time, and returns its bytes, none if there was no report.
type Reports = Box<dyn FnMut(Duration) -> Result<Vec<u8>, String> + Send>;
/// Opens a device, and returns its name and its reports.
type Opens = Arc<dyn Fn() -> Result<(String, Reports), String> + Send + Sync>;

/// What the thread has read of the device.
#[derive(Default)]
struct Cap {
    /// Translation, then rotation, along the cap's axes.
    axes: [AtomicI32; 6],
    buttons: AtomicU32,
    /// Why the device is lost, while it is.
    lost: Mutex<Option<String>>,
    ends: AtomicBool,
}

impl Cap {
    /// Takes over what a report says; one of another kind says nothing.
    fn take(&self, report: &[u8]) {
        let Some((kind, numbers)) = report.split_first() else { return };
        let axes = |from: usize| {
            for (axis, pair) in self.axes[from..].iter().zip(numbers.chunks_exact(2)) {
                axis.store(i16::from_le_bytes([pair[0], pair[1]]).into(), Relaxed);
            }
        };
        match kind {
            1 => axes(0),
            2 => axes(3),
            3 => {
                let bits = numbers.iter().take(4).rev().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
                self.buttons.store(bits, Relaxed);
            }
            _ => {}
        }
    }

    /// Velocity (m/s) and angular velocity (rad/s) that the cap asks for, in world axes: right, up, towards the user.
    fn velocities(&self) -> [DVec3; 2] {
        let share = |axis: &AtomicI32| {
            let push = (f64::from(axis.load(Relaxed)) / FULL).clamp(-1.0, 1.0);
            let above = (push.abs() - DEAD).max(0.0) / (1.0 - DEAD);
            above * above * push.signum()
        };
        let [x, y, z, about_x, about_y, about_z] = self.axes.each_ref().map(share);
        [SPEEDS[0] * DVec3::new(x, -z, y), SPEEDS[1] * DVec3::new(about_x, -about_z, about_y)]
    }

    /// Notes that the device is lost, or that it is back: then nothing pushes its cap.
    fn lose(&self, why: Option<String>) {
        self.axes.iter().for_each(|axis| axis.store(0, Relaxed));
        self.buttons.store(0, Relaxed);
        *self.lost.lock().unwrap_or_else(PoisonError::into_inner) = why;
    }
}

/// A SpaceMouse as a haptic device without force.
pub struct SpaceMouse {
    opens: Opens,
    goal: Goal,
    follower: Mouse,
    cap: Arc<Cap>,
    name: String,
    thread: Option<JoinHandle<()>>,
    time: f64,
}

impl SpaceMouse {
    /// A device that begins at a pose. `unit`: the name of the device or its path in the system; `None`: the first that
    /// the system lists.
    pub fn new(unit: Option<String>, position: DVec3, orientation: DQuat) -> SpaceMouse {
        SpaceMouse::with(Arc::new(move || open(unit.as_deref())), position, orientation)
    }

    fn with(opens: Opens, position: DVec3, orientation: DQuat) -> SpaceMouse {
        let goal = Goal::new(position, orientation);
        let (follower, cap, name) = (Mouse::new(goal.clone()), Arc::default(), String::new());
        SpaceMouse { opens, goal, follower, cap, name, thread: None, time: 0.0 }
    }
}

/// Whether a device is a multi-axis controller, and the one that `unit` names.
#[cfg(target_os = "linux")]
fn is_wanted(info: &DeviceInfo, unit: Option<&str>) -> bool {
    let is_it = |unit: &str| info.product_string() == Some(unit) || info.path().to_str() == Ok(unit);
    (info.usage_page(), info.usage()) == USAGE && unit.is_none_or(is_it)
}

/// Opens the multi-axis controller that `unit` names, or the first one.
#[cfg(not(target_os = "linux"))]
fn open(_: Option<&str>) -> Result<(String, Reports), String> {
    Err("a SpaceMouse can be read on Linux alone so far; use the mouse".into())
}

/// Opens the multi-axis controller that `unit` names, or the first one.
#[cfg(target_os = "linux")]
fn open(unit: Option<&str>) -> Result<(String, Reports), String> {
    let hid = HidApi::new().map_err(|e| format!("the system's input devices cannot be listed: {e}"))?;
    let Some(info) = hid.device_list().find(|info| is_wanted(info, unit)) else {
        let named = unit.map(|unit| format!(" called {unit}")).unwrap_or_default();
        return Err(format!("no SpaceMouse or other multi-axis controller{named} is plugged in; plug it in"));
    };
    let path = info.path().to_string_lossy().into_owned();
    let device = info.open_device(&hid).map_err(|e| {
        format!("{path} cannot be opened: {e}; allow this user to read it (on Linux by a rule of udev for `hidraw`)")
    })?;
    let name = info.product_string().unwrap_or("multi-axis controller").into();
    let reports = move |wait: Duration| {
        let mut bytes = [0; 64];
        let count = device.read_timeout(&mut bytes, wait.as_millis() as i32).map_err(|e| e.to_string())?;
        Ok(bytes[..count].to_vec())
    };
    Ok((name, Box::new(reports)))
}

/// Reads reports until the device is closed; opens it again when it was lost.
fn follow(cap: &Cap, opens: &Opens, first: Reports) {
    let mut reports = Some(first);
    while !cap.ends.load(Relaxed) {
        let read = match &mut reports {
            Some(reports) => reports(WAIT).map(|report| cap.take(&report)),
            None => opens().map(|(_, again)| {
                reports = Some(again);
                cap.lose(None);
            }),
        };
        if let Err(why) = read {
            reports = None;
            cap.lose(Some(why));
            thread::sleep(WAIT);
        }
    }
}

impl Device for SpaceMouse {
    fn open(&mut self) -> Result<(), Fault> {
        self.close();
        let (name, reports) = (self.opens)().map_err(Fault::Lost)?;
        (self.name, self.cap, self.time) = (name, Arc::default(), 0.0);
        self.follower.open()?;
        let (cap, opens) = (self.cap.clone(), self.opens.clone());
        let thread = thread::Builder::new().name("space-mouse".into()).spawn(move || follow(&cap, &opens, reports));
        self.thread = Some(thread.map_err(|e| Fault::Lost(format!("its thread cannot be started: {e}")))?);
        Ok(())
    }

    fn profile(&self) -> &Profile {
        self.follower.profile()
    }

    fn notes(&self) -> Vec<String> {
        vec![format!("{}: plays no force; the tool moves as long as the cap is pushed", self.name)]
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let span = (time - self.time).min(CATCH_UP);
        if span > 0.0 {
            let [velocity, angular_velocity] = self.cap.velocities();
            self.goal.shift(span * velocity);
            self.goal.turn(span * angular_velocity);
        }
        self.time = if time.is_finite() { time } else { self.time };
        let reading = self.follower.read(time)?;
        // While the thread writes what is read here, nothing pushes the cap, and the next reading tells.
        if let Some(why) = self.cap.lost.try_lock().ok().and_then(|why| why.clone()) {
            return Err(Fault::Lost(why));
        }
        Ok(Reading { buttons: self.cap.buttons.load(Relaxed), ..reading })
    }

    fn write(&mut self, _: &Wrench) -> Result<(), Fault> {
        Ok(())
    }

    fn close(&mut self) {
        self.cap.ends.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for SpaceMouse {
    fn drop(&mut self) {
        self.close();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
    use std::time::Instant;

    use super::*;

    /// A device whose reports a test sends, and whether it can be opened. When the sender is dropped it is unplugged;
    /// another receiver is the device plugged in again.
    fn plugged(receivers: Vec<Receiver<Vec<u8>>>) -> (SpaceMouse, Arc<AtomicBool>) {
        let (left, is_there) = (Mutex::new(receivers.into_iter()), Arc::new(AtomicBool::new(true)));
        let can_open = is_there.clone();
        let opens = move || {
            if !can_open.load(Relaxed) {
                return Err("nothing is plugged in".to_string());
            }
            let next = left.lock().unwrap().next().ok_or("nothing is plugged in")?;
            let reports: Reports = Box::new(move |wait| match next.recv_timeout(wait) {
                Ok(report) => Ok(report),
                Err(RecvTimeoutError::Timeout) => Ok(vec![]),
                Err(RecvTimeoutError::Disconnected) => Err("it was pulled out".into()),
            });
            Ok(("Test".into(), reports))
        };
        (SpaceMouse::with(Arc::new(opens), DVec3::new(0.3, 0.2, 0.1), DQuat::IDENTITY), is_there)
    }

    /// A report of a kind with 16-bit numbers.
    fn report(kind: u8, numbers: &[i16]) -> Vec<u8> {
        [kind].into_iter().chain(numbers.iter().flat_map(|number| number.to_le_bytes())).collect()
    }

    /// Waits until the thread has read all that was sent, and what was lost or is back.
    fn until(what: &str, holds: impl Fn() -> bool) {
        let begun = Instant::now();
        while !holds() {
            assert!(begun.elapsed() < Duration::from_secs(20), "it never came about that {what}");
            thread::sleep(Duration::from_millis(1));
        }
    }

    fn sent(device: &SpaceMouse, sender: &Sender<Vec<u8>>, reports: &[Vec<u8>], buttons: u32) {
        reports.iter().for_each(|report| sender.send(report.clone()).unwrap());
        sender.send(vec![3, buttons as u8, (buttons >> 8) as u8]).unwrap();
        until("the reports are read", || device.cap.buttons.load(Relaxed) == buttons);
    }

    /// Change of position and rotation vector over the readings of a second, at 1 kHz.
    fn moved(device: &mut SpaceMouse, from: f64) -> [DVec3; 2] {
        let first = device.read(from).unwrap().state;
        let last = (1..=1000).map(|k| device.read(from + 1e-3 * f64::from(k)).unwrap().state).last().unwrap();
        let turn = last.orientation * first.orientation.conjugate();
        [last.position - first.position, palpate::internal::step::trajectory::rotation_vector(turn)]
    }

    #[test]
    fn the_cap_moves_the_tool_along_the_axes_of_the_world() {
        let (sender, receiver) = channel();
        let (mut device, _) = plugged(vec![receiver]);
        device.open().unwrap();
        let directions = [DVec3::X, DVec3::Z, -DVec3::Y];
        for (k, direction) in directions.into_iter().enumerate() {
            let mut push = [0; 6];
            push[k] = 350;
            let alone = report(1, &push[..3]);
            // Newer models send the rotation with the translation.
            for (at, first) in [(0, alone), (1, report(1, &push))] {
                let mark = 1 + (2 * k + at) as u32;
                sent(&device, &sender, &[first, report(2, &[0, 0, 0])], mark);
                let from = 10.0 * f64::from(mark);
                device.read(from).unwrap();
                // In the first second the device still follows what was asked for before.
                moved(&mut device, from + 1.0);
                let [way, turn] = moved(&mut device, from + 2.0);
                assert!((way - 0.1 * direction).length() < 1e-3, "axis {k}: {way} m");
                assert!(turn.length() < 1e-9, "axis {k} turned the tool by {turn}");
            }
            let mark = 100 + k as u32;
            let mut turned = [0; 3];
            turned[k] = -350;
            sent(&device, &sender, &[report(1, &[0; 6]), report(2, &turned)], mark);
            let from = 10.0 * f64::from(mark);
            device.read(from).unwrap();
            moved(&mut device, from + 1.0);
            let [way, turn] = moved(&mut device, from + 2.0);
            assert!((turn + 1.5 * direction).length() < 1e-2, "axis {k}: turned by {turn} rad");
            assert!(way.length() < 1e-6, "axis {k}: {way} m while it turns");
        }
    }

    #[test]
    fn small_pushes_move_finely_and_what_is_no_report_moves_nothing() {
        let (sender, receiver) = channel();
        let (mut device, _) = plugged(vec![receiver]);
        device.open().unwrap();
        sent(&device, &sender, &[report(1, &[14, -14, 10])], 1);
        device.read(0.0).unwrap();
        let [way, _] = moved(&mut device, 1.0);
        assert_eq!(way, DVec3::ZERO, "within the dead zone");
        // Half of what is above the dead zone asks for a quarter of the speed.
        let half = (350.0 * (DEAD + 0.5 * (1.0 - DEAD))) as i16;
        sent(&device, &sender, &[report(1, &[half, 0, 0]), vec![], vec![1], vec![1, 7], vec![9, 255, 255]], 0x102);
        moved(&mut device, 10.0);
        let [way, _] = moved(&mut device, 11.0);
        assert!((way - 0.025 * DVec3::X).length() < 3e-4, "{way} m at half of the push");
        assert_eq!(device.read(20.0).unwrap().buttons, 0x102);
        device.write(&Wrench { force: DVec3::ONE, torque: DVec3::ONE }).unwrap();
    }

    #[test]
    fn a_device_that_is_pulled_out_stops_and_goes_on_from_there_when_it_is_back() {
        let (sender, receiver) = channel();
        let (again, other) = channel();
        let (mut device, is_there) = plugged(vec![receiver, other]);
        device.open().unwrap();
        sent(&device, &sender, &[report(1, &[350, 0, 0])], 1);
        moved(&mut device, 0.0);
        let cap = device.cap.clone();
        let is_lost = || cap.lost.lock().unwrap().is_some();
        is_there.store(false, Relaxed);
        drop(sender);
        until("it is lost", is_lost);
        let fault = device.read(1.1).unwrap_err().to_string();
        assert!(fault.contains("pulled out") || fault.contains("nothing is plugged in"), "{fault}");
        is_there.store(true, Relaxed);
        until("it is back", || !is_lost());
        let [way, _] = moved(&mut device, 2.0);
        let [rest, _] = moved(&mut device, 3.0);
        assert!(way.length() < 6e-3 && rest.length() < 1e-9, "{way} m, then {rest} m with a cap that nobody pushes");
        sent(&device, &again, &[report(1, &[0, 350, 0])], 2);
        moved(&mut device, 4.0);
        let [way, _] = moved(&mut device, 5.0);
        assert!((way - 0.1 * DVec3::Z).length() < 1e-3, "{way} m with the device that is back");
    }

    #[test]
    fn where_there_is_none_one_line_says_so() {
        let mut device = SpaceMouse::new(Some("no such device".into()), DVec3::ZERO, DQuat::IDENTITY);
        let fault = device.open().unwrap_err().to_string();
        let told = ["called no such device is plugged in", "cannot be listed", "on Linux alone"];
        let is_told = told.iter().any(|told| fault.contains(told));
        assert!(is_told && !fault.contains('\n'), "{fault}");
        let (mut empty, _) = plugged(vec![]);
        assert_eq!(empty.open(), Err(Fault::Lost("nothing is plugged in".into())));
        empty.close();
    }
}
