//! A session (a run of the haptic loop with device, tool and simulation) is recorded and replayed. The replay must give
//! the same bits, or name the first difference, by the tick (one cycle of the loop) or the simulation step.

use std::path::{Path, PathBuf};

use glam::DVec3;
use palpate::Scene;
use palpate::internal::haptics::Reading;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::stages::depth;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::{Key, Lowered, Profile, Samples};
use palpate_devices::record::{Header, Leader, Recorded, Recording};
use palpate_devices::replay::{Replayed, replay};

use crate::scene::touch::{Place, press};
use crate::scene::whole_step::open;

/// Number of ticks of the haptic loop, of 1 ms each.
const TICKS: u64 = 300;
/// Number of ticks from one simulation step to the next, and (`DELAY`) from the start of a step until the loop receives
/// the contact wrench of that step.
const EVERY: u64 = 15;
const DELAY: u64 = 9;

/// Records a session in virtual time (without a clock), in which the device follows the scene's keys (poses at given
/// times). `spoil` may change every tick before it is recorded. Returns the greatest contact force on the tool, N.
fn record(scene: &Scene, path: depth::Path, file: &Path, spoil: impl Fn(&mut Tick)) -> f64 {
    let mut simulation = open(scene, Some(path));
    let tool = simulation.tool().unwrap().clone();
    let (limits, _) = Limits::new(Profile::named("scripted").unwrap(), &Lowered::default());
    let settings = Settings {
        period: 1e-3,
        limits,
        local_model: true,
        passivity: true,
        most_damping: [30.0, 0.0],
        trust: 5e-3,
        arm: 0.02,
        resolution: 2e-5,
    };
    let trajectory =
        Trajectory::new(&scene.trajectory, Key { time: 0.0, position: tool.centre, orientation: tool.orientation });
    let leader = Leader { tool: "tool".into(), profile: "scripted".into(), device: "keys".into() };
    let header = Header::new(scene, &simulation, vec![leader]).unwrap();
    // A recording does not replace another.
    let _ = std::fs::remove_file(file);
    let mut recording = Recording::create(file, &header).unwrap();
    recording.begin(0, &settings, &tool).unwrap();
    let mut servo = Servo::new(settings, tool);
    let (mut newest, mut next, mut most) = (servo.newest(), servo.newest(), 0.0f64);
    for k in 0..TICKS {
        if k % EVERY == 0 {
            let (input, h) = (servo.input(), 1e-3 * EVERY as f64);
            next = simulation.feel(&input, h).unwrap();
            recording.step(&[input], h, &[next]).unwrap();
            most = most.max(next.wrench.force.length());
        }
        if k % EVERY == DELAY {
            newest = next;
        }
        let time = 1e-3 * k as f64;
        let reading = Reading { time, state: trajectory.device(0.3 * time, 1e-3), buttons: 0 };
        let mut tick = servo.tick(time, 0.0, Ok(reading), &newest);
        spoil(&mut tick);
        recording.tick(0, &tick).unwrap();
    }
    recording.finish().unwrap();
    most
}

fn again(scene: &Scene, path: depth::Path, file: &Path) -> Replayed {
    let recorded = Recorded::open(file).unwrap();
    let has_rays = scene.contact.samples == Samples::Vertices;
    assert_eq!(recorded.header.depth.as_deref(), has_rays.then_some(path.name()));
    let mut simulation = open(scene, Some(path));
    let replayed = replay(recorded, &mut simulation).unwrap();
    assert!(simulation.context().validation_messages().is_empty());
    replayed
}

/// Writes a scene to a file, in which the tool presses a block, of whose skin `samples` are tested, and slides along it.
/// Returns the scene, and the path of the file for a recording.
fn pressed(folder: &Path, samples: &str) -> (Scene, PathBuf) {
    let file = folder.join("scene.toml");
    let place = Place { slide: DVec3::new(0.01, 0.0, -0.005), ..Place::default() };
    std::fs::write(&file, press(2e4, 0.015, place, &format!("tolerance = 1e-5\n[contact]\nsamples = \"{samples}\"")))
        .unwrap();
    (Scene::load(&file).unwrap(), folder.join("session"))
}

#[test]
fn a_session_with_the_engine_replays_to_the_same_bits_on_both_depth_paths_and_by_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let (compute, graphics) = (depth::Path::Compute, depth::Path::Graphics);
    for (samples, path) in [("vertices", compute), ("vertices", graphics), ("triangles", compute)] {
        let (scene, file) = pressed(folder.path(), samples);
        let most = record(&scene, path, &file, |_| {});
        assert!(most > 0.1, "greatest force {most} N: nothing was touched");
        let replayed = again(&scene, path, &file);
        assert_eq!(replayed, Replayed { ticks: TICKS, steps: TICKS / EVERY, is_whole: true, difference: None });
    }
}

#[test]
fn a_reading_and_a_simulation_that_are_not_the_recorded_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (mut scene, file) = pressed(folder.path(), "vertices");
    let path = depth::Path::Compute;
    record(&scene, path, &file, |tick| {
        if tick.index == 200 {
            let y = &mut tick.reading.as_mut().unwrap().state.position.y;
            *y = f64::from_bits(y.to_bits() ^ 1);
        }
    });
    let spoiled = again(&scene, path, &file).difference.unwrap().to_string();
    assert!(spoiled.starts_with("tick 200 differs first in device_y: "), "unexpected report: {spoiled}");

    record(&scene, path, &file, |_| {});
    scene.contact.friction = 0.1;
    let other = again(&scene, path, &file).difference.unwrap().to_string();
    assert!(other.starts_with("step "), "unexpected report: {other}");
}
