//! Tests of sessions with several haptic devices: a fault of one device leaves the forces of the others as they are.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DQuat, DVec3};
use palpate::Wrench;
use palpate::internal::haptics::device::{Device, Fault, Reading};
use palpate::internal::haptics::environment::{Environment, Wall};
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::haptics::session::{Leader, Moment, Options, Report, hold_each};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::profile::Profile;
use palpate::scene::{Coupling, Haptics, Key};

use super::replay::reading_of;
use super::scripted::Scripted;

/// Duration of a session, and the time in it when the first device fails, s.
const SECONDS: f64 = 0.5;
const FAILS: std::ops::Range<f64> = 0.2..0.35;
/// Stiffness of the wall that each tool touches, N/m.
const WALL: f64 = 300.0;

/// How a device fails.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Failure {
    Lost,
    Stalled,
    NotANumber,
    Jumping,
}

impl Failure {
    const ALL: [Failure; 4] = [Failure::Lost, Failure::Stalled, Failure::NotANumber, Failure::Jumping];

    /// The event that tells of the failure; a device that stalls looks like one that is held still.
    fn event(self) -> Option<Event> {
        match self {
            Failure::Lost => Some(Event::DeviceLost),
            Failure::Stalled => None,
            Failure::NotANumber => Some(Event::BadReading),
            Failure::Jumping => Some(Event::PoseJump),
        }
    }
}

/// A device that follows a trajectory, and fails for some time.
struct Failing {
    device: Scripted,
    failure: Option<Failure>,
    before: Option<Reading>,
    /// Whether the device does not open, and how often it was closed.
    is_absent: bool,
    closed: Arc<AtomicUsize>,
}

impl Device for Failing {
    fn open(&mut self) -> Result<(), Fault> {
        if self.is_absent { Err(Fault::Lost("it is absent".into())) } else { self.device.open() }
    }

    fn profile(&self) -> &Profile {
        self.device.profile()
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let mut reading = self.device.read(time)?;
        match self.failure.filter(|_| FAILS.contains(&time)) {
            None => self.before = Some(reading),
            Some(Failure::Lost) => return Err(Fault::Lost("unplugged".into())),
            Some(Failure::Stalled) => reading = self.before.unwrap_or(reading),
            Some(Failure::NotANumber) => reading.state.position.z = f64::NAN,
            Some(Failure::Jumping) => reading.state.position += DVec3::X,
        }
        Ok(reading)
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        self.device.write(wrench)
    }

    fn close(&mut self) {
        self.closed.fetch_add(1, Ordering::Relaxed);
        self.device.close();
    }
}

/// A wall for each tool.
struct Walls(Vec<Wall>);

impl Environment for Walls {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> palpate::Result<Vec<ContactWrench>> {
        inputs.iter().zip(&mut self.0).map(|(input, wall)| wall.feel(input, h)).collect()
    }
}

fn tool() -> Tool {
    Tool {
        mass: 0.05,
        inertia: DMat3::IDENTITY * 2e-6,
        coupling: Some(Coupling { stiffness: 500.0, damping: 3.0, angular_stiffness: 0.1, angular_damping: 1e-3 }),
        centre: DVec3::Y * 0.003,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    }
}

/// What a session told of one device.
#[derive(Default)]
struct Heard {
    begin: Option<(Settings, Tool)>,
    ticks: Vec<Tick>,
    wrenches: Vec<ContactWrench>,
}

/// A device that presses on a wall, the deeper the greater its index.
fn device(index: usize) -> Failing {
    let key = |time: f64, y: f64| Key { time, position: DVec3::Y * y, orientation: DQuat::IDENTITY };
    let keys = [key(0.0, 0.003), key(0.1, -0.002 * (index + 1) as f64)];
    let profile = Profile::named("scripted").unwrap().clone();
    let device = Scripted::new(Trajectory::new(&keys, keys[0]), profile, 1e-3);
    Failing { device, failure: None, before: None, is_absent: false, closed: Arc::default() }
}

fn leader(index: usize, device: Failing) -> Leader {
    Leader { name: format!("tool {index}"), device: Box::new(device), tool: tool(), haptics: Haptics::default() }
}

fn walls(count: usize) -> Walls {
    let wall = |_| Wall { stiffness: WALL, damping: 0.0, tells_gap: true, tool: tool(), steps: 0 };
    Walls((0..count).map(wall).collect())
}

fn options() -> Options {
    Options { seconds: SECONDS, shortest_step: 0.005, stop: Arc::default(), bare_timer: false }
}

/// A session of `count` devices, of which the first fails.
fn session(count: usize, failure: Failure) -> (Vec<Report>, Vec<Heard>) {
    let devices = (0..count).map(|index| Failing { failure: (index == 0).then_some(failure), ..device(index) });
    let leaders = devices.enumerate().map(|(index, device)| leader(index, device)).collect();
    let mut heard: Vec<Heard> = (0..count).map(|_| Heard::default()).collect();
    let hear = |moment: Moment| {
        match moment {
            Moment::Begin(index, settings, tool) => heard[index].begin = Some((*settings, tool.clone())),
            Moment::Tick(index, tick) => heard[index].ticks.push(*tick),
            Moment::Step(inputs, _, wrenches) => {
                assert_eq!([inputs.len(), wrenches.len()], [count; 2]);
                heard.iter_mut().zip(wrenches).for_each(|(heard, wrench)| heard.wrenches.push(*wrench));
            }
            Moment::Note(_) => {}
        }
        Ok(())
    };
    let reports = hold_each(leaders, &mut walls(count), &options(), hear).unwrap();
    (reports, heard)
}

#[test]
fn a_device_that_does_not_open_releases_the_others() {
    let first = device(0);
    let closed = first.closed.clone();
    let second = Failing { is_absent: true, ..device(1) };
    let leaders = vec![leader(0, first), leader(1, second)];
    let error = hold_each(leaders, &mut walls(2), &options(), |_| Ok(())).unwrap_err();
    assert_eq!(error.to_string(), "tool 1: the haptic device is lost: it is absent");
    assert_eq!(closed.load(Ordering::Relaxed), 1);
    let none = hold_each(Vec::new(), &mut walls(2), &options(), |_| Ok(())).unwrap_err();
    assert!(none.to_string().contains("needs a haptic device"), "{none}");
}

#[test]
fn a_fault_of_one_device_leaves_the_others_forces_as_they_are() {
    for (count, failure) in [2, 4].into_iter().flat_map(|count| Failure::ALL.map(|failure| (count, failure))) {
        let (reports, heard) = session(count, failure);
        assert_eq!(reports.len(), count);
        for (index, (report, heard)) in reports.iter().zip(&heard).enumerate() {
            let place = format!("{count} devices, the first is {failure:?}: device {index}");
            assert_eq!((report.tool.as_str(), &report.ended), (format!("tool {index}").as_str(), &None), "{place}");
            let failed = Failure::ALL.into_iter().filter_map(Failure::event).map(|event| report.events.ticks(event));
            let failed: Vec<u64> = failed.collect();
            let told = failure.event().filter(|_| index == 0);
            assert_eq!(failed.iter().any(|ticks| *ticks > 0), told.is_some(), "{place}: events {failed:?}");
            assert!(told.is_none_or(|event| report.events.ticks(event) > 20), "{place}: events {failed:?}");
            let (settings, tool) = heard.begin.clone().unwrap();
            let played = heard.ticks.iter().map(|tick| tick.played.force.length()).fold(0.0, f64::max);
            assert!(played <= settings.limits.force && heard.ticks.len() > 100, "{place}: {played} N");
            assert!(played > 0.1, "{place}: its wall was felt with {played} N");

            // A loop by itself that is given the same readings and wrenches plays the same bits.
            let mut servo = Servo::new(settings, tool);
            for tick in &heard.ticks {
                let wrench = heard.wrenches.iter().find(|wrench| wrench.step == tick.step).copied();
                let alone = servo.tick(tick.time, tick.late, reading_of(tick), &wrench.unwrap_or(servo.newest()));
                let bits = |wrench: Wrench| [wrench.force, wrench.torque].map(|v| v.to_array().map(f64::to_bits));
                assert_eq!(bits(alone.played), bits(tick.played), "{place}: tick {}", tick.index);
            }
        }
    }
}
