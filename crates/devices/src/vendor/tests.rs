//! Tests of the drivers against stand-ins for the makers' libraries (`stand_in`): poses and wrenches in the right units
//! and axes, and what happens where something is absent or fails. Nothing here has met a real device.

#[path = "stand_in/places.rs"]
mod places;

use std::process::Command;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::SeqCst;

use glam::{DMat3, DQuat};
use palpate::scene::profile::{DELTA, FALCON, OMEGA, PREMIUM, SIGMA, TOUCH};

use super::*;
use crate::safety_check::{self, Finding, Guide};
use places::*;

/// Longest time that a test waits for a condition; each condition here holds sooner.
const PATIENCE: Duration = Duration::from_secs(8);
const COMMUNICATION_ERROR: f64 = 770.0;
const TOO_MUCH_FORCE: f64 = 513.0;
const WARM_MOTORS: f64 = 512.0;

/// A stand-in library of a test of its own, since a library that is opened twice shares its memory.
struct StandIn {
    _folder: tempfile::TempDir,
    file: PathBuf,
    library: libloading::Library,
}

impl StandIn {
    /// Compiles a file of `stand_in`; the device is there and calibrated.
    fn new(name: &str, kind: f64) -> StandIn {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(format!("{name}.so"));
        let source = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("src/vendor/stand_in/{name}.rs"));
        let compiler = std::env::var("RUSTC").unwrap_or("rustc".into());
        let arguments = ["--edition", "2024", "--crate-type", "cdylib", "-C", "opt-level=1", "--crate-name", name];
        let done = Command::new(compiler).args(arguments).arg(&source).arg("-o").arg(&file).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        // SAFETY: the library was compiled here.
        let library = unsafe { libloading::Library::new(&file) }.unwrap();
        let stand_in = StandIn { _folder: folder, file, library };
        stand_in.set(IS_THERE, &[1.0]);
        stand_in.set(IS_CALIBRATED, &[1.0]);
        stand_in.set(TYPE, &[kind]);
        stand_in.set(SERIAL, &[1.0]);
        for bank in [0, SECOND_DEVICE] {
            stand_in.set(bank + AXES, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        }
        stand_in
    }

    fn memory(&self, place: usize) -> &AtomicU64 {
        // SAFETY: the library exports a static of this type.
        let all = unsafe { self.library.get::<*const [AtomicU64; LENGTH]>(b"STAND_IN") }.unwrap();
        // SAFETY: it lives as long as the library.
        unsafe { &(&**all)[place] }
    }

    fn set(&self, place: usize, values: &[f64]) {
        values.iter().enumerate().for_each(|(k, value)| self.memory(place + k).store(value.to_bits(), SeqCst));
    }

    fn get(&self, place: usize) -> f64 {
        f64::from_bits(self.memory(place).load(SeqCst))
    }

    fn three(&self, place: usize) -> DVec3 {
        DVec3::new(self.get(place), self.get(place + 1), self.get(place + 2))
    }

    fn set_axes(&self, axes: DMat3) {
        let rows = axes.transpose();
        self.set(AXES, &rows.to_cols_array());
    }

    fn settings(&self) -> Settings {
        Settings { library: Some(self.file.clone()), home: DVec3::new(1.0, 2.0, 3.0), ..Settings::default() }
    }
}

fn opened<L: Library>(stand_in: &StandIn) -> Vendor<L> {
    let mut device = Vendor::new(stand_in.settings());
    device.open().unwrap();
    device
}

/// Reads the device and writes a force to it, once a millisecond, until a condition holds.
fn tick_until<L: Library>(
    device: &mut Vendor<L>,
    wrench: Wrench,
    mut done: impl FnMut(Result<Reading, Fault>) -> bool,
) {
    let started = Instant::now();
    loop {
        let reading = device.read(0.0);
        // It fails after a pause of this thread.
        let _ = device.write(&wrench);
        if done(reading) {
            return;
        }
        assert!(started.elapsed() < PATIENCE, "the condition did not hold");
        thread::sleep(Duration::from_millis(1));
    }
}

fn wait_until(mut done: impl FnMut() -> bool) {
    let started = Instant::now();
    while !done() {
        assert!(started.elapsed() < PATIENCE, "the condition did not hold");
        thread::sleep(Duration::from_micros(200));
    }
}

fn push(force: DVec3) -> Wrench {
    Wrench { force, torque: DVec3::ZERO }
}

fn lost(done: Result<(), Fault>) -> String {
    let said = done.unwrap_err().to_string();
    assert!(!said.contains(char::is_control), "not one line: {said:?}");
    said
}

const TURN: DQuat = DQuat::from_xyzw(0.2, -0.4, 0.1, 0.888_819_4);
const PLACE: DVec3 = DVec3::new(0.011, -0.023, 0.037);
const TWIST: [DVec3; 2] = [DVec3::new(0.3, -0.2, 0.5), DVec3::new(-1.5, 2.5, 0.7)];

/// Whether a reading is that of a device that was at `home` at first, and is moved by `PLACE` and turned by `TURN`.
fn has_moved(reading: Reading) -> bool {
    let state = &reading.state;
    state.position.distance(DVec3::new(1.0, 2.0, 3.0) + PLACE) < 1e-12
        && state.orientation.angle_between(TURN.normalize()) < 1e-6
        && state.velocity.distance(TWIST[0]) < 1e-12
        && state.angular_velocity.distance(TWIST[1]) < 1e-12
        && reading.buttons == 5
}

/// The device's axes x (to the user), y (to the right) and z (up), in palpate's: z, x and y.
#[test]
fn force_dimension_in_its_axes() {
    let stand_in = StandIn::new("dhd", 104.0);
    let axes = DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y);
    let mut device: ForceDimension = opened(&stand_in);
    assert_eq!(device.profile(), &Profile { senses_rotation: true, ..SIGMA });
    assert_eq!(stand_in.get(IS_ENABLED), 0.0, "forces are on before one is commanded");
    assert_eq!(device.notes().len(), 1, "notes: {:?}", device.notes());
    assert!(device.notes()[0].contains("stand-in 7") && device.notes()[0].contains("serial number 1"));
    let back = axes.transpose();
    stand_in.set_axes(back * DMat3::from_quat(TURN.normalize()) * axes);
    stand_in.set(VELOCITY, &(back * TWIST[0]).to_array());
    stand_in.set(ANGULAR_VELOCITY, &(back * TWIST[1]).to_array());
    stand_in.set(BUTTONS, &[5.0]);
    stand_in.set(POSITION, &(back * PLACE).to_array());
    let wrench = Wrench { force: DVec3::new(1.0, 2.0, 3.0), torque: DVec3::new(0.01, 0.02, 0.03) };
    let played = || [stand_in.three(WRENCH), stand_in.three(WRENCH + 3)];
    let expected = [DVec3::new(3.0, 1.0, 2.0), DVec3::new(0.03, 0.01, 0.02)];
    tick_until(&mut device, wrench, |reading| reading.is_ok_and(has_moved) && played() == expected);
    device.close();
    assert_eq!((played(), stand_in.get(CLOSED), stand_in.get(MISUSES)), ([DVec3::ZERO; 2], 1.0, 0.0));
    assert!(matches!(device.read(0.0), Err(Fault::Lost(_))) && device.write(&Wrench::ZERO).is_err());
}

/// Millimetres, in the axes of palpate; no torque.
#[test]
fn touch_in_its_units() {
    let stand_in = StandIn::new("hd", 0.0);
    let mut device: Touch = opened(&stand_in);
    assert_eq!(device.profile(), &TOUCH);
    stand_in.set_axes(DMat3::from_quat(TURN.normalize()));
    stand_in.set(VELOCITY, &(1e3 * TWIST[0]).to_array());
    stand_in.set(ANGULAR_VELOCITY, &TWIST[1].to_array());
    stand_in.set(BUTTONS, &[5.0]);
    stand_in.set(POSITION, &(1e3 * PLACE).to_array());
    let force = DVec3::new(1.0, 2.0, 1.5);
    tick_until(&mut device, push(force), |reading| reading.is_ok_and(has_moved) && stand_in.three(WRENCH) == force);
    let _ = device.write(&push(force));
    device.close();
    let ends = [stand_in.get(CLOSED), stand_in.get(MISUSES), stand_in.get(IS_ENABLED)];
    assert_eq!((ends, stand_in.three(WRENCH)), ([1.0, 0.0, 0.0], DVec3::ZERO));
    // It can be opened again, at another place, which is home.
    device.open().unwrap();
    let home = |r: Reading| r.state.position.distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12;
    tick_until(&mut device, Wrench::ZERO, |reading| reading.is_ok_and(home));
}

#[test]
fn what_is_absent_is_named_in_one_line() {
    let none = || Settings { library: Some("/nowhere/libnone.so".into()), ..Settings::default() };
    assert!(lost(Touch::new(none()).open()).contains("install OpenHaptics"));
    assert!(lost(ForceDimension::new(none()).open()).contains("install Force Dimension's SDK"));
    let dhd = StandIn::new("dhd", 104.0);
    let hd = StandIn::new("hd", 0.0);
    // Each library lacks the functions of the other.
    let swapped = |stand_in: &StandIn| Settings { library: Some(stand_in.file.clone()), ..Settings::default() };
    assert!(lost(Touch::new(swapped(&dhd)).open()).contains("no function hdInitDevice"));
    assert!(lost(ForceDimension::new(swapped(&hd)).open()).contains("no function dhdGetDeviceCount"));
    let unit = |stand_in: &StandIn, unit: &str| Settings { unit: Some(unit.into()), ..stand_in.settings() };
    assert!(lost(ForceDimension::new(unit(&dhd, "left")).open()).contains("\"left\" is no serial number"));
    assert!(lost(ForceDimension::new(unit(&dhd, "2")).open()).contains("none of serial number 2 can be opened"));
    assert!(ForceDimension::new(unit(&dhd, "1")).open().is_ok());
    dhd.set(SECOND, &[99.0]);
    assert!(ForceDimension::new(unit(&dhd, "1")).open().is_ok());
    let mut first = ForceDimension::new(dhd.settings());
    first.open().unwrap();
    assert!(first.notes()[0].contains("serial number 99"), "{:?}", first.notes());
    first.close();
    dhd.set(SECOND, &[0.0]);
    assert!(lost(Touch::new(unit(&hd, "Right Device")).open()).contains("no device called \"Right Device\""));
    assert!(Touch::new(unit(&hd, "Left Device")).open().is_ok());
    dhd.set(IS_CALIBRATED, &[0.0]);
    hd.set(IS_CALIBRATED, &[0.0]);
    assert!(lost(ForceDimension::new(dhd.settings()).open()).contains("not calibrated"));
    // A Phantom whose place is taken for the neutral one is not calibrated by the driver.
    hd.set(STYLES, &[1.0]);
    assert!(lost(Touch::new(hd.settings()).open()).contains("its arm in the neutral place"));
    assert_eq!(hd.get(CALIBRATIONS), 0.0);
    hd.set(STYLES, &[4.0]);
    hd.set(NEEDS_HAND, &[1.0]);
    assert!(lost(Touch::new(hd.settings()).open()).contains("put its stylus into the inkwell"));
    // One that can calibrate by itself does.
    hd.set(NEEDS_HAND, &[0.0]);
    hd.set(STYLES, &[2.0]);
    assert!(Touch::new(hd.settings()).open().is_ok());
    assert_eq!(hd.get(CALIBRATIONS), 1.0);
    for stand_in in [&dhd, &hd] {
        stand_in.set(IS_CALIBRATED, &[1.0]);
        stand_in.set(IS_THERE, &[0.0]);
    }
    assert!(lost(ForceDimension::new(dhd.settings()).open()).contains("communication error"));
    assert!(lost(Touch::new(hd.settings()).open()).contains("Communication error"));
    let all_closed = |stand_in: &StandIn| stand_in.get(OPENED) == stand_in.get(CLOSED);
    assert!(all_closed(&dhd) && all_closed(&hd), "a device stayed open");
    assert_eq!([dhd.get(MISUSES), hd.get(MISUSES)], [0.0; 2]);
    let fast = Settings { rate: 1e9, ..dhd.settings() };
    assert!(lost(ForceDimension::new(fast).open()).contains("use a rate"));
}

/// Each of two devices has its own place and force; a fault and the end of one leave the other alone.
#[test]
fn two_devices_of_one_maker_are_held_at_the_same_time() {
    fn check<L: Library>(stand_in: &StandIn, units: [&str; 2], scale: f64, error: usize) {
        stand_in.set(SECOND, &[99.0]);
        let new = |k: usize| Vendor::<L>::new(Settings { unit: Some(units[k].into()), ..stand_in.settings() });
        let mut devices = [new(0), new(1)];
        devices.iter_mut().for_each(|device| device.open().unwrap());
        for k in 0..2 {
            assert!(lost(new(k).open()).contains("open in this program already"), "device {k}");
        }
        let bank = [0, SECOND_DEVICE];
        let home = DVec3::new(1.0, 2.0, 3.0);
        (0..2).for_each(|k| stand_in.set(bank[k] + POSITION, &(scale * place(k)).to_array()));
        fn place(k: usize) -> DVec3 {
            DVec3::splat([0.01, -0.02][k])
        }
        let force = [DVec3::splat(1.0), DVec3::splat(-1.5)];
        let is_right = |k: usize, reading: &Result<Reading, Fault>| {
            let is_there = |r: &Reading| r.state.position.distance(home + place(k)) < 1e-9;
            reading.as_ref().is_ok_and(is_there) && stand_in.three(bank[k] + WRENCH) == force[k]
        };
        // Plays on both, until a condition on both readings holds.
        let both = |devices: &mut [Vendor<L>; 2], done: &mut dyn FnMut([Result<Reading, Fault>; 2]) -> bool| {
            let [first, second] = devices;
            tick_until(first, push(force[0]), |reading| {
                let _ = second.write(&push(force[1]));
                done([reading, second.read(0.0)])
            });
        };
        both(&mut devices, &mut |readings| (0..2).all(|k| is_right(k, &readings[k])));
        // An error of one is none of the other.
        for (ill, well) in [(1, 0), (0, 1)] {
            stand_in.set(bank[ill] + error, &[COMMUNICATION_ERROR]);
            let mut count = 0;
            both(&mut devices, &mut |readings| {
                let said = readings[well].as_ref().err().map(Fault::to_string).unwrap_or_default();
                assert!(!said.to_lowercase().contains("error"), "device {well} says {said}");
                let is_still = stand_in.three(bank[ill] + WRENCH) == DVec3::ZERO;
                count += usize::from(readings[ill].is_err() && is_still && is_right(well, &readings[well]));
                count > 30
            });
            stand_in.set(bank[ill] + error, &[0.0]);
            both(&mut devices, &mut |readings| (0..2).all(|k| is_right(k, &readings[k])));
        }
        // The end of one is none of the other, and it can be opened again.
        let closed = stand_in.get(CLOSED);
        devices[1].close();
        assert_eq!((stand_in.three(SECOND_DEVICE + WRENCH), stand_in.get(CLOSED)), (DVec3::ZERO, closed + 1.0));
        tick_until(&mut devices[0], push(force[0]), |reading| is_right(0, &reading));
        stand_in.set(SECOND_DEVICE + POSITION, &[0.0; 3]);
        let [first, second] = &mut devices;
        thread::scope(|scope| {
            let opening = scope.spawn(|| second.open().unwrap());
            tick_until(first, push(force[0]), |_| opening.is_finished());
        });
        stand_in.set(SECOND_DEVICE + POSITION, &(scale * place(1)).to_array());
        both(&mut devices, &mut |readings| (0..2).all(|k| is_right(k, &readings[k])));
        // Sessions close their devices at the same time.
        thread::scope(|scope| devices.iter_mut().for_each(|device| drop(scope.spawn(|| device.close()))));
        let forces = bank.map(|bank| stand_in.three(bank + WRENCH));
        assert_eq!(forces, [DVec3::ZERO; 2]);
        assert_eq!((stand_in.get(OPENED), stand_in.get(MISUSES)), (stand_in.get(CLOSED), 0.0));
    }
    check::<Dhd>(&StandIn::new("dhd", 104.0), ["1", "99"], 1.0, ERROR);
    check::<OpenHaptics>(&StandIn::new("hd", 0.0), ["Left Device", "Right Device"], 1e3, LATE_ERROR);
}

#[test]
fn the_type_decides_the_profile() {
    let stand_in = StandIn::new("dhd", 0.0);
    for (kind, profile, senses_rotation, notes) in [
        (33.0, OMEGA, false, 1),
        (35.0, OMEGA, true, 1),
        (60.0, FALCON, false, 1),
        (63.0, DELTA.without_torque(), false, 1),
        (64.0, DELTA, true, 1),
        (108.0, SIGMA, true, 1),
        (206.0, SIGMA.without_torque(), true, 1),
        (999.0, FALCON, true, 2),
    ] {
        stand_in.set(TYPE, &[kind]);
        let mut device = ForceDimension::new(stand_in.settings());
        assert_eq!(device.profile(), &FALCON);
        device.identify().unwrap();
        assert_eq!(device.profile(), &Profile { senses_rotation, ..profile }, "type {kind}");
        assert_eq!(device.notes().len(), notes, "notes: {:?}", device.notes());
        assert_eq!(stand_in.get(IS_ENABLED), 0.0);
    }
    let stand_in = StandIn::new("hd", 0.0);
    for (kind, profile, notes) in [(0.0, &TOUCH, 1), (1.0, &PREMIUM, 1), (2.0, &TOUCH, 2), (3.0, &TOUCH, 1)] {
        stand_in.set(TYPE, &[kind]);
        let own = profile.without_torque();
        for asked in [None, Some(&TOUCH), Some(&SIGMA), Some(&FALCON)] {
            let mut device = Touch::new(Settings { profile: asked, ..stand_in.settings() });
            device.identify().unwrap();
            let granted = device.profile();
            assert!(granted.is_within(&own) && asked.is_none_or(|asked| granted.is_within(asked)), "type {kind}");
            assert!(granted.max_force == own.max_force.min(asked.map_or(f64::INFINITY, |asked| asked.max_force)));
            let is_higher = asked.is_some_and(|asked| !asked.is_within(&own));
            assert_eq!(device.notes().len(), notes + usize::from(is_higher), "notes: {:?}", device.notes());
        }
    }
}

/// A wrench beyond the limits is shortened; one that is not renewed, or not finite, is not played.
#[test]
fn no_wrench_beyond_the_limits_nor_an_old_one() {
    fn check<L: Library>(stand_in: &StandIn) {
        let mut device: Vendor<L> = opened(stand_in);
        let most = device.profile().max_force;
        let length = || stand_in.three(WRENCH).length();
        tick_until(&mut device, push(DVec3::new(60.0, 80.0, 0.0)), |_| length() > 0.0);
        assert!((length() - most).abs() < 1e-9, "played {} N of {most} N", length());
        wait_until(|| length() == 0.0);
        // The wrench after the pause is a fault, so that the force returns slowly, and is not played.
        assert!(matches!(device.write(&push(DVec3::X)), Err(Fault::Lost(_))));
        tick_until(&mut device, push(DVec3::X), |_| length() > 0.0);
        tick_until(&mut device, push(DVec3::new(0.0, f64::NAN, 0.0)), |_| length() == 0.0);
    }
    check::<Dhd>(&StandIn::new("dhd", 104.0));
    check::<OpenHaptics>(&StandIn::new("hd", 0.0));
}

/// An error in a call and a pose that is no number: a fault, no force, and then the device is well again.
#[test]
fn faults_end_the_force_and_pass() {
    fn check<L: Library>(stand_in: &StandIn, fault: (usize, f64), is_lost: bool) {
        let mut device: Vendor<L> = opened(stand_in);
        let well = stand_in.get(fault.0);
        let force = || stand_in.three(WRENCH);
        tick_until(&mut device, push(DVec3::X), |reading| reading.is_ok() && force() != DVec3::ZERO);
        stand_in.set(fault.0, &[fault.1]);
        let mut seen = None;
        tick_until(&mut device, push(DVec3::X), |reading| {
            seen = reading.err();
            seen.is_some()
        });
        assert_eq!(matches!(seen, Some(Fault::Lost(_))), is_lost, "seen: {seen:?}");
        tick_until(&mut device, push(DVec3::X), |_| force() == DVec3::ZERO);
        for _ in 0..30 {
            tick_until(&mut device, push(DVec3::X), |reading| reading.is_err());
            assert_eq!(force(), DVec3::ZERO, "a force is played while the device is not well");
        }
        stand_in.set(fault.0, &[well]);
        tick_until(&mut device, push(DVec3::X), |reading| reading.is_ok() && force() != DVec3::ZERO);
        // A fault of one sample lasts long enough to be read.
        let samples = stand_in.get(SAMPLES);
        stand_in.set(fault.0, &[fault.1]);
        let seen = if fault.0 == IS_OFF { 25.0 } else { 2.0 };
        wait_until(|| stand_in.get(SAMPLES) > samples + seen);
        stand_in.set(fault.0, &[well]);
        wait_until(|| device.read(0.0).is_err());
        device.close();
        assert_eq!((force(), stand_in.get(MISUSES)), (DVec3::ZERO, 0.0));
    }
    check::<Dhd>(&StandIn::new("dhd", 104.0), (ERROR, 1.0), true);
    check::<Dhd>(&StandIn::new("dhd", 104.0), (AXES + 4, f64::NAN), false);
    check::<OpenHaptics>(&StandIn::new("hd", 0.0), (ERROR, COMMUNICATION_ERROR), true);
    check::<OpenHaptics>(&StandIn::new("hd", 0.0), (ERROR, TOO_MUCH_FORCE), true);
    // Forces that the device itself has switched off.
    check::<Dhd>(&StandIn::new("dhd", 104.0), (IS_OFF, 1.0), true);
    check::<OpenHaptics>(&StandIn::new("hd", 0.0), (POSITION + 1, f64::INFINITY), false);
}

/// An unplugged device is lost; plugged in again, the same one goes on, and another one does not.
#[test]
fn an_unplugged_device_is_lost_and_only_the_same_one_comes_back() {
    let stand_in = StandIn::new("dhd", 104.0);
    let mut device: ForceDimension = opened(&stand_in);
    let unplug = |device: &mut ForceDimension| {
        stand_in.set(IS_THERE, &[0.0]);
        tick_until(device, push(DVec3::X), |reading| matches!(reading, Err(Fault::Lost(_))));
        tick_until(device, push(DVec3::X), |_| stand_in.get(CLOSED) == stand_in.get(OPENED));
        stand_in.set(IS_THERE, &[1.0]);
    };
    unplug(&mut device);
    tick_until(&mut device, push(DVec3::X), |reading| reading.is_ok() && stand_in.get(OPENED) == 2.0);
    unplug(&mut device);
    stand_in.set(SERIAL, &[7.0]);
    let is_absent = |fault: Fault| fault.to_string().contains("none of serial number 1 can be opened");
    tick_until(&mut device, push(DVec3::X), |reading| reading.is_err_and(is_absent));
    assert_eq!(stand_in.three(WRENCH), DVec3::ZERO);
    device.close();
    assert!(lost(device.open()).contains("begin another"));

    let stand_in = StandIn::new("hd", 0.0);
    let mut device: Touch = opened(&stand_in);
    stand_in.set(IS_THERE, &[0.0]);
    tick_until(&mut device, push(DVec3::X), |reading| matches!(reading, Err(Fault::Lost(_))));
    tick_until(&mut device, push(DVec3::X), |_| stand_in.three(WRENCH) == DVec3::ZERO);
}

/// Motors that are too warm rest for seconds, not for a sample.
#[test]
fn warm_motors_cool_down() {
    let stand_in = StandIn::new("hd", 0.0);
    let mut device: Touch = opened(&stand_in);
    tick_until(&mut device, push(DVec3::X), |_| stand_in.three(WRENCH) != DVec3::ZERO);
    stand_in.set(ERROR, &[WARM_MOTORS]);
    tick_until(&mut device, push(DVec3::X), |reading| reading.is_err());
    stand_in.set(ERROR, &[0.0]);
    tick_until(&mut device, push(DVec3::X), |_| stand_in.three(WRENCH) == DVec3::ZERO);
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(500) {
        tick_until(&mut device, push(DVec3::X), |reading| reading.is_err_and(|f| f.to_string().contains("warm")));
        assert_eq!(stand_in.three(WRENCH), DVec3::ZERO);
    }
}

/// A library that calls nothing any more, or cannot schedule: closing ends soon, and the device is released.
#[test]
fn a_library_that_hangs_is_left() {
    for (hangs, is_released) in [(1.0, true), (2.0, false)] {
        let stand_in = StandIn::new("hd", 0.0);
        let mut device: Touch = opened(&stand_in);
        stand_in.set(HANGS, &[hangs]);
        let begun = Instant::now();
        device.close();
        assert!(begun.elapsed() < Duration::from_millis(900), "closing took {:?}", begun.elapsed());
        assert!(!is_released || stand_in.get(CLOSED) == 1.0);
        wait_until(|| stand_in.get(CLOSED) == 1.0);
        assert_eq!(stand_in.get(MISUSES), 0.0);
    }
    // Another device of the library waits for it, but not for ever.
    let stand_in = StandIn::new("hd", 0.0);
    stand_in.set(SECOND, &[99.0]);
    let second = || Touch::new(Settings { unit: Some("Right Device".into()), ..stand_in.settings() });
    let mut device: Touch = opened(&stand_in);
    stand_in.set(HANGS, &[4.0]);
    device.close();
    let begun = Instant::now();
    assert!(lost(second().open()).contains("does not return from another device: end the program"));
    assert!(begun.elapsed() < 2 * OPEN_WAIT, "opening took {:?}", begun.elapsed());
    stand_in.set(HANGS, &[0.0]);
    wait_until(|| stand_in.get(CLOSED) == 1.0);
    assert!(second().open().is_ok());
    assert_eq!(stand_in.get(MISUSES), 0.0);
    let stand_in = StandIn::new("hd", 0.0);
    stand_in.set(HANGS, &[3.0]);
    assert!(lost(Touch::new(stand_in.settings()).open()).contains("nothing can be scheduled"));
    assert_eq!((stand_in.get(CLOSED), stand_in.get(MISUSES)), (1.0, 0.0));
}

/// The check of a device passes over each driver, with a handle on a spring that is moved about at first.
#[test]
#[ignore = "takes 15 s"]
fn a_device_with_its_driver_passes_the_check() {
    fn run<L: Library>(stand_in: &StandIn, unit: f64) -> Result<Vec<Finding>, String> {
        let mut device: Vendor<L> = opened(stand_in);
        let stop = AtomicBool::new(false);
        let begun = Instant::now();
        let found = thread::scope(|scope| {
            scope.spawn(|| {
                while !stop.load(SeqCst) {
                    // 3 mm a newton, reached with a time constant of 10 ms.
                    let to_and_fro =
                        0.01 * (2.0 * (begun.elapsed().as_secs_f64() - 0.5).clamp(0.0, std::f64::consts::PI)).sin();
                    let goal = DVec3::splat(to_and_fro) + 3e-3 * stand_in.three(WRENCH);
                    let place = stand_in.three(POSITION) / unit;
                    stand_in.set(POSITION, &(unit * (place + 0.1 * (goal - place))).to_array());
                    thread::sleep(Duration::from_millis(1));
                }
            });
            let mut wait = |time: f64| {
                thread::sleep(Duration::from_secs_f64(time).saturating_sub(begun.elapsed()));
                begun.elapsed().as_secs_f64()
            };
            let ended = AtomicBool::new(false);
            let mut say = |_: &str| {};
            let mut guide = Guide { wait: &mut wait, say: &mut say, stop: &ended, has_watchdog: true };
            let found = safety_check::check(&mut device, &mut guide);
            stop.store(true, SeqCst);
            found
        });
        device.close();
        assert_eq!((stand_in.three(WRENCH), stand_in.get(MISUSES)), (DVec3::ZERO, 0.0));
        found
    }
    // A stall of the machine for 50 ms ends a check, as it should; one of three goes through.
    fn passes<L: Library>(stand_in: &StandIn, unit: f64) {
        let mut found = Vec::new();
        let is_well = |one: &Result<Vec<Finding>, String>| {
            one.as_ref().is_ok_and(|parts| parts.len() == 9 && parts.iter().all(|part| part.is_well))
        };
        while found.len() < 3 && !found.last().is_some_and(is_well) {
            found.push(run::<L>(stand_in, unit));
        }
        assert!(found.last().is_some_and(is_well), "{found:#?}");
    }
    thread::scope(|scope| {
        scope.spawn(|| passes::<Dhd>(&StandIn::new("dhd", 104.0), 1.0));
        scope.spawn(|| passes::<OpenHaptics>(&StandIn::new("hd", 0.0), 1e3));
    });
}

/// A minute at 1 kHz with each device: every reading lies on the path that the device follows, and every force that it
/// plays is one that was commanded.
#[test]
#[ignore = "takes a minute"]
fn lasting_a_minute_of_samples_and_forces() {
    fn run<L: Library>(stand_in: &StandIn, to_device: impl Fn(DVec3) -> DVec3, unit: f64) {
        let path = |t: f64| DVec3::new(0.03 * t.sin(), 0.02 * (1.3 * t).cos() - 0.02, 0.01 * (0.7 * t).sin());
        let mut device: Vendor<L> = opened(stand_in);
        let (begun, home) = (Instant::now(), DVec3::new(1.0, 2.0, 3.0));
        let (mut readings, mut played) = (0, 0);
        for k in 0..60_000u32 {
            let t = begun.elapsed().as_secs_f64();
            stand_in.set(POSITION, &(unit * to_device(path(t))).to_array());
            let place = device.read(t).map_or(DVec3::NAN, |reading| reading.state.position - home);
            // The sample is some milliseconds old, more where the machine is busy. Its three numbers may be of two
            // moments.
            let is_on_path = (0..50).any(|ms| path(t - 1e-3 * f64::from(ms)).distance(place) < 1e-4);
            readings += usize::from(is_on_path);
            let force = DVec3::new(0.5, -1.0, 0.25) * f64::from(k % 3);
            let _ = device.write(&push(force));
            let now = stand_in.three(WRENCH);
            let along = now.dot(to_device(DVec3::new(0.5, -1.0, 0.25))) / (0.25 + 1.0 + 0.0625);
            played += usize::from([0.0, 1.0, 2.0].iter().any(|share| (along - share).abs() < 1e-9));
            thread::sleep((begun + Duration::from_millis(k.into())).saturating_duration_since(Instant::now()));
        }
        let seconds = begun.elapsed().as_secs_f64();
        println!("{seconds:.1} s, {} samples, {readings} readings, {played} wrenches", stand_in.get(SAMPLES));
        // A twentieth may be lost to stalls of the machine.
        assert!(readings > 57_000 && played > 57_000, "{readings} readings on the path, {played} forces");
        assert!(stand_in.get(SAMPLES) > 500.0 * seconds && stand_in.get(MISUSES) == 0.0);
    }
    thread::scope(|scope| {
        scope.spawn(|| run::<Dhd>(&StandIn::new("dhd", 104.0), |v| DVec3::new(v.z, v.x, v.y), 1.0));
        scope.spawn(|| run::<OpenHaptics>(&StandIn::new("hd", 0.0), |v| v, 1e3));
    });
}
