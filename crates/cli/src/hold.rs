//! Runs a scene whose tool (the rigid body that a user moves) is held by a haptic device: makes the device, runs the
//! session (one run of the haptic loop) and records the session.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::Path;

use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{self, Moment, Options, Report};
use palpate::internal::haptics::{Device, Fault};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::profile::PROFILES;
use palpate::scene::{DeviceKind, HaplyService, Haptics, Key, Leader, Profile};
use palpate::{Error, Result, Scene, Simulation, StepReport};
use palpate_devices::record::{self, Header, Outcome, Recording};
use palpate_devices::{ForceDimension, Hand, Haply, Replay, Scripted, Steered, Touch, haply, vendor};
use palpate_page::Reduced;

use crate::engine::Engine;
use crate::signals::Stop;
use crate::tell;

/// The built-in profile (limits of a haptic device: force, workspace and so on) that the settings name; if they name
/// none, the profile whose name is the argument `default`. The settings' resolution of the device, if any, takes the
/// place of the profile's.
fn profile_of(haptics: &Haptics, default: &str) -> Profile {
    let named = haptics.profile.or_else(|| Profile::named(default));
    let profile = named.unwrap_or(&PROFILES[0]).clone();
    Profile { resolution: haptics.resolution.or(profile.resolution), ..profile }
}

/// Sets the profile of the scene's haptic device by name, whatever profile the scene gives.
///
/// # Errors
/// There is no such profile, no haptic device holds the tool, or the device cannot have that profile.
pub fn choose_profile(scene: &mut Scene, name: &str) -> Result<()> {
    let wrong = |problem: &str, remedy: &str| Err(Error::Usage(format!("--profile {name} {problem}: {remedy}")));
    let Some(profile) = Profile::named(name) else {
        let names = PROFILES.map(|profile| profile.name).join(", ");
        return wrong("is not a profile", &format!("give one of {names}"));
    };
    if !scene.haptics.has_device {
        return wrong(
            "applies to a haptic device, but none holds the tool",
            "give --haptics DEVICE as well, or leave it out",
        );
    }
    if scene.haptics.device == DeviceKind::Replay {
        return wrong("does not apply to a replay, which has the profile of its recording", "leave it out");
    }
    // The drivers of Touch and Force Dimension themselves take the lower of each limit.
    scene.haptics.device.check_profile(profile).or_else(|(problem, remedy)| wrong(problem, &remedy))?;
    scene.haptics.profile = Some(profile);
    Ok(())
}

/// What the scene says of the device that leads the tool of this index, which must be there.
fn leader_of(scene: &Scene, index: usize) -> Result<Leader<'_>> {
    let missing = || Error::Usage("the scene has no tool for the haptic device; add a [tool]".into());
    scene.leader(index).ok_or_else(missing)
}

/// Makes a haptic device of a scene; it begins at the pose `start` or, if it follows keys, where they are at the time
/// `elapsed`, s.
fn device_of(scene: &Scene, leader: &Leader, elapsed: f64, start: Key) -> Result<Box<dyn Device>> {
    let haptics = &leader.haptics;
    let keys: Vec<Key> = leader.trajectory.iter().map(|key| Key { time: key.time - elapsed, ..*key }).collect();
    let trajectory = Trajectory::new(&keys, start);
    let wrong = |key: &str, problem: &str, remedy: &str| {
        Error::key(&scene.file, format!("{}.{key}", leader.key), problem, remedy)
    };
    if let (Some(profile), false) = (haptics.profile, haptics.device.plays_force()) {
        let device = haptics.device.name();
        tell(&format!("the scene's profile {} does not apply to {device}, which plays no force", profile.name));
    }
    Ok(match haptics.device {
        DeviceKind::Scripted => {
            Box::new(Scripted::new(trajectory, profile_of(haptics, "scripted"), 1.0 / haptics.rate))
        }
        DeviceKind::Hand => {
            let hand = Hand::new(haptics.hand, trajectory, profile_of(haptics, "premium"));
            Box::new(hand.map_err(|problem| wrong("hand", &problem, "correct it"))?)
        }
        DeviceKind::Replay => {
            let missing = || wrong("recording", "is missing", "give the recording to play");
            Box::new(Replay::open(haptics.recording.as_ref().ok_or_else(missing)?, leader.index)?)
        }
        DeviceKind::Haply => {
            let settings = haply::Settings {
                home: start.position,
                rate: haptics.rate,
                profile: haptics.profile,
                service: haptics.haply.clone(),
            };
            let mut haply = Haply::new(settings);
            // The profile of a real device depends on its type. The session takes limits from the profile before it
            // opens the device, so the type is asked for now.
            haply.identify().map_err(no_device)?;
            Box::new(haply)
        }
        DeviceKind::Touch => {
            let mut touch = Touch::new(vendor_settings(haptics, start));
            touch.identify().map_err(no_device)?;
            Box::new(touch)
        }
        DeviceKind::ForceDimension => {
            let mut device = ForceDimension::new(vendor_settings(haptics, start));
            device.identify().map_err(no_device)?;
            Box::new(device)
        }
        kind @ (DeviceKind::SpaceMouse | DeviceKind::GamePad | DeviceKind::OpenXr) => {
            let mut steered = Steered::new(kind, haptics.unit.clone(), start.position, start.orientation);
            steered.identify().map_err(no_device)?;
            Box::new(steered)
        }
    })
}

fn vendor_settings(haptics: &Haptics, start: Key) -> vendor::Settings {
    vendor::Settings {
        unit: haptics.unit.clone(),
        home: start.position,
        rate: haptics.rate,
        profile: haptics.profile,
        ..vendor::Settings::default()
    }
}

fn no_device(fault: Fault) -> Error {
    Error::NoDevice(fault.to_string())
}

/// The environment (source of contact wrenches) of the haptic loop: the engine. After every step, when the loop has its
/// wrench, `watch` is called with its report and with the simulation.
struct Watched<'a> {
    engine: &'a mut Engine,
    report: Option<StepReport>,
    watch: &'a mut dyn FnMut(&StepReport, &mut Simulation) -> Result<()>,
}

impl Environment for Watched<'_> {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let (row, wrenches) = self.engine.step_device_inputs(inputs, h)?;
        self.report = Some(row);
        Ok(wrenches)
    }

    fn after(&mut self) -> Result<()> {
        let report = self.report.take();
        report.map_or(Ok(()), |report| (self.watch)(&report, self.engine.simulation_mut()))
    }
}

/// Gathers the force played (commanded to a device), N, over the time since its loop's first tick (iteration), s.
#[derive(Default)]
pub struct Played {
    begin: Option<f64>,
    /// The curve of the force over time.
    pub force: Reduced<1>,
}

impl Played {
    fn add(&mut self, tick: &Tick) {
        let begin = *self.begin.get_or_insert(tick.time);
        self.force.add(tick.time - begin, [tick.played.force.length()]);
    }
}

/// Runs a session with the scene's haptic devices for `seconds`, or until a signal ends it, and records the session into
/// the file `record`, if one is given. `watch` is called with the report of every step, and with the simulation after it.
/// Returns a report for each device, and puts into `played` what each played.
pub fn hold(
    engine: &mut Engine,
    scene: &Scene,
    seconds: f64,
    record: Option<&Path>,
    watch: &mut dyn FnMut(&StepReport, &mut Simulation) -> Result<()>,
    played: &mut Vec<Played>,
) -> Result<Vec<Report>> {
    if engine.simulation().tool().is_none() {
        return Err(Error::key(
            &scene.file,
            "tool",
            "is missing, but a haptic device needs a tool to hold",
            "add a [tool]",
        ));
    }
    let leaders = leaders(engine.simulation(), scene)?;
    *played = leaders.iter().map(|_| Played::default()).collect();
    let mut recording = record.map(|path| recording(path, engine, scene, &leaders)).transpose()?;
    // Outcomes of the steps that are not recorded yet: the session tells of steps later, of the first ones together.
    let takes_outcomes = recording.as_ref().is_some_and(Recording::takes_outcomes);
    let outcomes = RefCell::new(VecDeque::new());
    let mut watch = |row: &StepReport, simulation: &mut Simulation| {
        if takes_outcomes {
            outcomes.borrow_mut().push_back(Outcome { contacts: simulation.contacts()?, flags: row.flags });
        }
        watch(row, simulation)
    };
    // A signal ends the session in order, and the device is released.
    let stop = Stop::or_suspended()?;
    let options = Options { seconds, shortest_step: scene.step.dt, stop: stop.flag(), bare_timer: true };
    let write = |moment: Moment| match (&mut recording, moment) {
        (_, Moment::Note(note)) => {
            tell(note);
            Ok(())
        }
        (recording, Moment::Tick(index, tick)) => {
            played[index].add(tick);
            recording.as_mut().map_or(Ok(()), |recording| recording.tick(index, tick))
        }
        (None, _) => Ok(()),
        (Some(recording), Moment::Begin(index, settings, tool)) => recording.begin(index, settings, tool),
        (Some(recording), Moment::Step(inputs, h, wrenches)) => {
            recording.step(inputs, h, wrenches)?;
            let outcome = outcomes.borrow_mut().pop_front();
            outcome.map_or(Ok(()), |outcome| recording.outcome(inputs[0].time, &outcome))
        }
    };
    let mut environment = Watched { engine, report: None, watch: &mut watch };
    let held = session::hold_each(leaders, &mut environment, &options, write);
    let has_begun = played.iter().any(|played| played.begin.is_some());
    if let (Err(_), false, Some(path)) = (&held, has_begun, record) {
        // Of a session that did not begin there is nothing to keep.
        let _ = std::fs::remove_file(path);
    }
    let reports = held?;
    recording.map_or(Ok(()), |recording| recording.finish().map(drop))?;
    Ok(reports)
}

/// Makes the haptic devices that a scene asks for, each with the tool of its simulation that it leads.
pub fn leaders(simulation: &Simulation, scene: &Scene) -> Result<Vec<session::Leader>> {
    let start = |tool: &Tool| Key { time: 0.0, position: tool.centre, orientation: tool.orientation };
    let devices = simulation.tools().take(scene.held_tools()).map(|tool| (start(tool), None));
    leaders_with(simulation, scene, 0.0, devices.collect())
}

/// Like [`leaders`], for as many tools as `devices` has elements: for each the pose at which its device begins, and the
/// device if it is not one of the scene. `elapsed`: time of the scene's keys at which the session begins, s.
pub fn leaders_with(
    simulation: &Simulation,
    scene: &Scene,
    elapsed: f64,
    devices: Vec<(Key, Option<Box<dyn Device>>)>,
) -> Result<Vec<session::Leader>> {
    let described: Vec<_> = (0..devices.len()).map(|index| leader_of(scene, index)).collect::<Result<_>>()?;
    let of_scene = described.iter().zip(&devices).filter(|(_, (_, device))| device.is_none()).map(|(leader, _)| leader);
    let of_scene: Vec<_> = of_scene.collect();
    for (index, leader) in of_scene.iter().enumerate() {
        if let Some(other) = of_scene[..index].iter().find(|other| !are_apart(&other.haptics, &leader.haptics)) {
            let remedy = match leader.haptics.device {
                DeviceKind::Haply => "give each a `device_id` and a `grip` of its own in `haply` (`\"none\"`: no grip)",
                _ => "give each a `unit` of its own",
            };
            let or_grip = if leader.haptics.device == DeviceKind::Haply { ", or have its grip" } else { "" };
            let problem = format!("may be the device of {}{or_grip}", other.tool);
            return Err(Error::key(&scene.file, format!("{}.device", leader.key), problem, remedy));
        }
    }
    let is_one_of_several = devices.len() > 1;
    let make = |((leader, (start, own)), tool): ((Leader, (Key, Option<_>)), &Tool)| {
        let device =
            own.map_or_else(|| device_of(scene, &leader, elapsed, start), Ok).map_err(|error| match error {
                Error::NoDevice(why) if is_one_of_several => Error::NoDevice(format!("{}: {why}", leader.tool)),
                error => error,
            })?;
        Ok(session::Leader { name: leader.tool.into(), device, tool: tool.clone(), haptics: leader.haptics })
    };
    described.into_iter().zip(devices).zip(simulation.tools()).map(make).collect()
}

/// Whether two settings are of different devices, which can be held at the same time.
fn are_apart(a: &Haptics, b: &Haptics) -> bool {
    let differ = |a: &Option<String>, b: &Option<String>| a.is_some() && b.is_some() && a != b;
    match (a.device, b.device) {
        (DeviceKind::Haply, DeviceKind::Haply) => {
            let [a, b] = [&a.haply, &b.haply];
            let without = |grip: &Option<String>| grip.as_deref() == Some(HaplyService::NO_GRIP);
            differ(&a.device_id, &b.device_id) && (differ(&a.grip, &b.grip) || without(&a.grip) || without(&b.grip))
        }
        (DeviceKind::OpenXr, DeviceKind::OpenXr) => {
            let hand = |unit: &Option<String>| unit.clone().unwrap_or_else(|| "right".into());
            hand(&a.unit) != hand(&b.unit)
        }
        (one, other) => one != other || !one.has_units() || differ(&a.unit, &b.unit),
    }
}

/// Refuses a file for a recording that is there already.
pub fn refuse_existing(path: &Path) -> Result<()> {
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    let problem = "is there already, and no session is ever the same again";
    Err(Error::input(path, None, problem, "record into another file, or remove this one"))
}

fn recording(path: &Path, engine: &Engine, scene: &Scene, leaders: &[session::Leader]) -> Result<Recording> {
    let named = |leader: &session::Leader| record::Leader {
        tool: leader.name.clone(),
        profile: leader.device.profile().name.into(),
        device: leader.haptics.device.name().into(),
    };
    Recording::create(path, &Header::new(scene, engine.simulation(), leaders.iter().map(named).collect())?)
}
