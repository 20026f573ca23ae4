//! Tests of the gallery, the scenes in assets/gallery: each can be read, runs to its end without a flag, and looks like
//! its picture in assets/pictures. A *flag* marks what went wrong in a step; the *tool* is the rigid body that the
//! haptic device leads.
//!
//! `palpate figures --gallery --out assets/pictures` makes the pictures again. Look at the new pictures before you
//! keep them.
#![cfg(feature = "view")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use palpate::{Flags, Options, Scene, Simulation, StepReport, Threads};

#[path = "harness/likeness.rs"]
mod likeness;

/// The scenes of the gallery.
const NAMES: [&str; 9] =
    ["cushion", "drag", "finger", "forearm", "gears", "lump", "needle", "pad-in-hand", "two-bodies"];
/// Greatest size of a file in the gallery or of a picture, bytes.
const LARGEST: u64 = 150_000;
/// Least ratio, in the scene `lump`, of the force on the tool above the hidden lump to the force beside the lump; 2.0
/// was measured.
const FELT: f64 = 1.8;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn file(name: &str) -> PathBuf {
    root().join(format!("assets/gallery/{name}.toml"))
}

fn picture(name: &str) -> PathBuf {
    root().join(format!("assets/pictures/gallery-{name}.png"))
}

fn device() -> Option<String> {
    std::env::var("PALPATE_TEST_DEVICE").ok()
}

#[test]
fn every_scene_of_the_gallery_is_read_and_says_what_it_is() {
    let mut found = Vec::new();
    for entry in fs::read_dir(root().join("assets/gallery")).unwrap() {
        let entry = entry.unwrap();
        assert!(entry.metadata().unwrap().len() <= LARGEST, "{} is too large a file", entry.path().display());
        let name = entry.file_name().into_string().unwrap();
        // A file whose name ends in `-bones.toml` describes the bones of a scene and is no scene itself.
        found.extend(name.strip_suffix(".toml").filter(|name| !name.ends_with("-bones")).map(String::from));
    }
    found.sort();
    assert_eq!(found, NAMES);
    for name in NAMES {
        Scene::load(&file(name)).unwrap_or_else(|error| panic!("{error}"));
        let text = fs::read_to_string(file(name)).unwrap();
        let comment: Vec<&str> = text.lines().take_while(|line| line.starts_with('#')).collect();
        assert!(
            (2..=4).contains(&comment.len()),
            "{name}: the comment at the start must have 2 to 4 lines; it has {}",
            comment.len()
        );
        let command = format!("palpate run assets/gallery/{name}.toml");
        assert!(
            comment[comment.len() - 1].contains(&command),
            "{name}: the last line of the comment lacks `{command}`"
        );
        let size = fs::metadata(picture(name)).unwrap_or_else(|error| panic!("{name}: no picture: {error}")).len();
        assert!(size <= LARGEST, "{name}: the picture is too large: {size} bytes");
    }
}

/// Runs a scene to its end, checks that no step raises a flag, and returns the reports of the steps.
fn run(name: &str) -> Vec<StepReport> {
    let scene = Scene::load(&file(name)).unwrap();
    let options = Options { device: device(), threads: Some(Threads::Auto), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options).unwrap();
    let steps = (scene.duration() / scene.step.dt).round() as usize;
    let rows: Vec<StepReport> = (0..steps).map(|_| simulation.step().unwrap()).collect();
    for row in &rows {
        assert_eq!(row.flags, Flags::default(), "{name}: wrong flags in step {}", row.step);
    }
    rows
}

/// Mean contact force on the tool, N, over the steps in which `is_there` holds of the x coordinate (m) of the tool's
/// position.
fn mean_force(rows: &[StepReport], is_there: impl Fn(f64) -> bool) -> f64 {
    let tools = rows.iter().filter_map(|row| row.tool.as_ref());
    let there = tools.filter(|tool| is_there(tool.tool.position.x)).map(|tool| tool.force.length());
    let forces: Vec<f64> = there.collect();
    assert!(!forces.is_empty());
    forces.iter().sum::<f64>() / forces.len() as f64
}

/// This test lasts for two minutes on two CPU cores.
#[test]
#[ignore = "lasts for minutes"]
fn lasting_the_gallery_runs_to_its_end_without_flags() {
    for name in NAMES {
        let rows = run(name);
        let contacts = rows.iter().filter(|row| row.contacts.is_some_and(|count| count > 0)).count();
        println!("{name}: of {} steps, {contacts} have contacts", rows.len());
        assert!(4 * contacts > rows.len(), "{name}: only {contacts} of {} steps have contacts", rows.len());
        if name == "lump" {
            let over = mean_force(&rows, |x| x.abs() < 0.003);
            let beside = mean_force(&rows, |x| (0.02..0.035).contains(&x.abs()));
            println!("mean force: {over:.2} N over the lump, {beside:.2} N beside the lump");
            assert!(over > FELT * beside, "the force is only {over} N over the lump; beside it: {beside} N");
        }
    }
}

/// This test lasts for a minute on two CPU cores.
#[test]
#[ignore = "lasts for a minute"]
fn lasting_the_gallery_looks_like_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.current_dir(root()).args(["figures", "--gallery", "--out"]).arg(folder.path());
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(device) = device() {
        command.args(["--device", &device]);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for name in NAMES {
        let made = folder.path().join(format!("gallery-{name}.png"));
        let alike = likeness::likeness(&likeness::read(&made), &likeness::read(&picture(name)));
        println!("{name}: the similarity to the committed picture is {alike:.4}");
        assert!(
            alike > likeness::ALIKE,
            "{name}: the picture has a similarity of only {alike:.3} to the committed picture"
        );
    }
}
