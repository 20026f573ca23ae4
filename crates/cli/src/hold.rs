//! Runs a scene whose tool (the rigid body that a user moves) is held by a haptic device: makes the device, runs the
//! session (one run of the haptic loop) and records the session.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::Path;

use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{self, Moment, Options, Report};
use palpate::internal::haptics::{Device, Fault};
use palpate::internal::step::trajectory::Trajectory;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::profile::PROFILES;
use palpate::scene::{DeviceKind, Key, Profile};
use palpate::{Error, Result, Scene, Simulation, StepReport};
use palpate_devices::record::{Header, Outcome, Recording};
use palpate_devices::{ForceDimension, Hand, Haply, Replay, Scripted, SpaceMouse, Touch, haply, vendor};
use palpate_page::Reduced;

use crate::engine::Engine;
use crate::signals::Stop;
use crate::tell;

/// The built-in profile (limits of a haptic device: force, workspace and so on) that the scene names; if it names none,
/// the profile whose name is the argument `default`. The scene's resolution of the device, if any, takes the place of
/// the profile's.
fn profile_of(scene: &Scene, default: &str) -> Profile {
    let named = scene.haptics.profile.or_else(|| Profile::named(default));
    let profile = named.unwrap_or(&PROFILES[0]).clone();
    Profile { resolution: scene.haptics.resolution.or(profile.resolution), ..profile }
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

/// Makes the haptic device that a scene asks for; the device begins at the pose `start`.
pub fn device(scene: &Scene, start: Key) -> Result<Box<dyn Device>> {
    let haptics = &scene.haptics;
    let trajectory = Trajectory::new(&scene.trajectory, start);
    Ok(match haptics.device {
        DeviceKind::Scripted => Box::new(Scripted::new(trajectory, profile_of(scene, "scripted"), 1.0 / haptics.rate)),
        DeviceKind::Hand => {
            let hand = Hand::new(haptics.hand, trajectory, profile_of(scene, "premium"));
            Box::new(hand.map_err(|problem| Error::key(&scene.file, "haptics.hand", problem, "correct it"))?)
        }
        DeviceKind::Replay => {
            let missing = || Error::key(&scene.file, "haptics.recording", "is missing", "give the recording to play");
            Box::new(Replay::open(haptics.recording.as_ref().ok_or_else(missing)?)?)
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
            let mut touch = Touch::new(vendor_settings(scene, start));
            touch.identify().map_err(no_device)?;
            Box::new(touch)
        }
        DeviceKind::ForceDimension => {
            let mut device = ForceDimension::new(vendor_settings(scene, start));
            device.identify().map_err(no_device)?;
            Box::new(device)
        }
        DeviceKind::SpaceMouse => {
            if let Some(profile) = haptics.profile {
                let name = profile.name;
                tell(&format!("the scene's profile {name} does not apply to a SpaceMouse, which plays no force"));
            }
            Box::new(SpaceMouse::new(haptics.unit.clone(), start.position, start.orientation))
        }
    })
}

fn vendor_settings(scene: &Scene, start: Key) -> vendor::Settings {
    vendor::Settings {
        unit: scene.haptics.unit.clone(),
        home: start.position,
        rate: scene.haptics.rate,
        profile: scene.haptics.profile,
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
    fn feel(&mut self, input: &DeviceInput, h: f64) -> Result<ContactWrench> {
        let (row, wrench) = self.engine.step_device_input(input, h)?;
        self.report = Some(row);
        Ok(wrench)
    }

    fn after(&mut self) -> Result<()> {
        let report = self.report.take();
        report.map_or(Ok(()), |report| (self.watch)(&report, self.engine.simulation_mut()))
    }
}

/// Gathers the force played (commanded to the device), N, over the time since the loop's first tick (iteration), s.
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

/// Runs a session with the scene's haptic device for `seconds`, or until a signal ends it, and records the session into
/// the file `record`, if one is given. `watch` is called with the report of every step, and with the
/// simulation after it.
pub fn hold(
    engine: &mut Engine,
    scene: &Scene,
    seconds: f64,
    record: Option<&Path>,
    watch: &mut dyn FnMut(&StepReport, &mut Simulation) -> Result<()>,
    played: &mut Played,
) -> Result<Report> {
    let Some(tool) = engine.simulation().tool().cloned() else {
        return Err(Error::key(
            &scene.file,
            "tool",
            "is missing, but a haptic device needs a tool to hold",
            "add a [tool]",
        ));
    };
    let start = Key { time: 0.0, position: tool.centre, orientation: tool.orientation };
    let device = device(scene, start)?;
    let mut recording = record.map(|path| recording(path, engine, scene, device.profile())).transpose()?;
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
        (recording, Moment::Tick(tick)) => {
            played.add(tick);
            recording.as_mut().map_or(Ok(()), |recording| recording.tick(tick))
        }
        (None, _) => Ok(()),
        (Some(recording), Moment::Begin(settings, tool)) => recording.begin(settings, tool),
        (Some(recording), Moment::Step(input, h, wrench)) => {
            recording.step(input, h, wrench)?;
            let outcome = outcomes.borrow_mut().pop_front();
            outcome.map_or(Ok(()), |outcome| recording.outcome(input, &outcome))
        }
    };
    let mut environment = Watched { engine, report: None, watch: &mut watch };
    let held = session::hold(device, &tool, &scene.haptics, &mut environment, &options, write);
    if let (Err(_), None, Some(path)) = (&held, played.begin, record) {
        // Of a session that did not begin there is nothing to keep.
        let _ = std::fs::remove_file(path);
    }
    let report = held?;
    recording.map_or(Ok(()), |recording| recording.finish().map(drop))?;
    Ok(report)
}

/// Refuses a file for a recording that is there already.
pub fn refuse_existing(path: &Path) -> Result<()> {
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    let problem = "is there already, and no session is ever the same again";
    Err(Error::input(path, None, problem, "record into another file, or remove this one"))
}

fn recording(path: &Path, engine: &Engine, scene: &Scene, profile: &Profile) -> Result<Recording> {
    let header = Header::new(scene, engine.simulation(), profile.name, scene.haptics.device.name())?;
    Recording::create(path, &header)
}
