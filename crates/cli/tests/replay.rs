//! Tests of `palpate replay` through the built program: a recorded session (a run of the haptic loop with the
//! simulation) is replayed, and recordings that cannot be replayed are refused. A *tick* is one iteration of the haptic
//! loop; the *tool* is the rigid body that the haptic device leads; a *wrench* is a force with a torque.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::DVec3;
use palpate::internal::haptics::Reading;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::scene::{Lowered, Profile};
use palpate::{Options, RigidState, Scene, Simulation};
use palpate_devices::record::{Header, Leader, Recording};

/// A scene in which the tool, a ball of 50 g, begins 0.5 mm above a soft block; [`record`] pushes it into the block.
const SCENE: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"bottom\"\nbind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.0505, 0.0]\n\
    [coupling]\nstiffness = 500.0\ndamping = 2.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n";
/// Number of ticks in the session.
const TICKS: u64 = 120;
/// Number of ticks from one simulation step to the next. The wrench of a step is already used in the tick in which the
/// step is done.
const EVERY: u64 = 15;

/// Runs the program; returns exit status, standard output and standard error.
fn palpate(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// Writes a scene file and a recording of a session with that scene; returns the paths of both. Without `has_end` the
/// recording breaks off after the last tick. `spoil` may change every tick before it is recorded.
fn record(folder: &Path, has_end: bool, spoil: impl Fn(&mut Tick)) -> (PathBuf, PathBuf) {
    let (scene, file) = (folder.join("scene.toml"), folder.join("session"));
    fs::write(&scene, SCENE).unwrap();
    let mut loaded = Scene::load(&scene).unwrap();
    loaded.haptics.has_device = true;
    let mut simulation = Simulation::open(&loaded, &Options::of_program()).unwrap();
    let tool = simulation.tool().unwrap().clone();
    let (limits, _) = Limits::new(Profile::named("scripted").unwrap(), &Lowered::default());
    let (local_model, passivity) = (true, true);
    let settings = Settings {
        period: 1e-3,
        limits,
        local_model,
        passivity,
        most_damping: [30.0, 0.0],
        trust: 5e-3,
        arm: 0.02,
        resolution: 2e-5,
    };
    // A recording does not replace another.
    let _ = fs::remove_file(&file);
    let leaders = vec![Leader { tool: "tool".into(), profile: "scripted".into(), device: "down".into() }];
    let header = Header::new(&loaded, &simulation, leaders).unwrap();
    let mut recording = Recording::create(&file, &header).unwrap();
    recording.begin(0, &settings, &tool).unwrap();
    let mut servo = Servo::new(settings, tool.clone());
    let mut newest = servo.newest();
    for k in 0..TICKS {
        let time = 1e-3 * k as f64;
        if k % EVERY == 0 {
            let held = servo.input();
            newest = simulation.feel(&held, 0.015).unwrap();
            recording.step(&[held], 0.015, &[newest]).unwrap();
        }
        let state = RigidState::at_rest(tool.centre - DVec3::Y * 0.05 * time, tool.orientation);
        let mut tick = servo.tick(time, 0.0, Ok(Reading { time, state, buttons: 0 }), &newest);
        spoil(&mut tick);
        recording.tick(0, &tick).unwrap();
    }
    assert!(newest.wrench.force.y > 0.05, "the contact force of the last step is too small: {newest:?}");
    if has_end {
        recording.finish().unwrap();
    }
    (scene, file)
}

#[test]
fn a_session_is_replayed_to_the_same_bits_and_written_as_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, file) = record(folder.path(), true, |_| {});
    let file = file.to_str().unwrap();
    let same = format!("replayed {TICKS} ticks and 8 steps: the same bits\n");
    assert_eq!(palpate(&["replay", file]), (0, same.clone(), String::new()));

    let table = folder.path().join("ticks");
    let wrote = palpate(&["replay", file, "--csv", table.to_str().unwrap()]);
    assert_eq!(wrote, (0, format!("wrote {TICKS} ticks\n"), String::new()));
    assert_eq!(fs::read_to_string(&table).unwrap().lines().count(), 1 + TICKS as usize);
    // A table does not replace the recording that it is read from.
    let (status, _, said) = palpate(&["replay", file, "--csv", file]);
    assert!(status == 2 && said.contains("this command reads it"), "{said}");

    // If the scene file has the same meaning but other bytes, the session is replayed and a note is printed.
    let elsewhere = folder.path().join("elsewhere.toml");
    fs::write(&elsewhere, format!("# The same.\n{SCENE}")).unwrap();
    let (status, out, notes) = palpate(&["replay", file, "--scene", elsewhere.to_str().unwrap()]);
    assert_eq!((status, out), (0, same));
    assert!(notes.starts_with("note: ") && notes.contains("has changed since the recording"), "notes printed: {notes}");

    fs::write(&scene, SCENE.replace("2e4", "3e4")).unwrap();
    let (status, _, error) = palpate(&["replay", file]);
    assert_eq!(status, 2);
    assert!(error.contains("scene.toml: has changed since the recording; restore it"), "wrong error: {error}");
    let (status, _, error) = palpate(&["replay", file, "--scene", scene.to_str().unwrap()]);
    assert_eq!(status, 4);
    assert!(error.contains("step ") && error.contains(" differs first in "), "wrong error: {error}");

    fs::remove_file(&scene).unwrap();
    let (status, _, error) = palpate(&["replay", file]);
    assert_eq!(status, 2);
    assert!(error.contains("scene.toml does not exist; give the scene by --scene"), "wrong error: {error}");
}

#[test]
fn what_differs_is_named_and_what_was_cut_short_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = record(folder.path(), false, |_| {});
    let (status, out, notes) = palpate(&["replay", file.to_str().unwrap()]);
    assert_eq!((status, out), (0, format!("replayed {TICKS} ticks and 8 steps: the same bits\n")));
    assert!(
        notes.starts_with("note: ") && notes.contains("cut short") && notes.lines().count() == 1,
        "notes printed: {notes}"
    );

    let (_, file) = record(folder.path(), true, |tick| {
        if tick.index == 77 {
            tick.played.force.y = f64::from_bits(tick.played.force.y.to_bits() ^ 1);
        }
    });
    let (status, out, error) = palpate(&["replay", file.to_str().unwrap()]);
    assert_eq!((status, out.as_str(), error.lines().count()), (4, "", 1), "wrong error: {error}");
    assert!(error.contains("tick 77 differs first in played_force_y: "), "wrong error: {error}");
}

#[test]
fn what_is_no_recording_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (file, table) = (folder.path().join("session"), folder.path().join("made/ticks.csv"));
    fs::write(&file, "tick,time_s\n").unwrap();
    for arguments in [vec![], vec!["--csv", table.to_str().unwrap()]] {
        let (status, _, error) = palpate(&[&["replay", file.to_str().unwrap()], arguments.as_slice()].concat());
        assert_eq!((status, error.lines().count()), (2, 1), "wrong error: {error}");
        assert!(error.contains("session: is not a recording"), "wrong error: {error}");
    }
    assert!(!folder.path().join("made").exists());
    let missing = folder.path().join("missing");
    let (status, _, error) = palpate(&["replay", missing.to_str().unwrap()]);
    assert_eq!(status, 2);
    assert!(error.contains("missing: cannot be read"), "wrong error: {error}");
    let (status, _, error) = palpate(&["replay", folder.path().to_str().unwrap()]);
    assert_eq!((status, error.lines().count()), (2, 1), "wrong error: {error}");
}
