//! The tool, a rigid sphere that the haptic device leads, presses into a whole soft head, and the force on it must rise
//! smoothly. One head is that of a scene that comes with the program; the other is a scanned head, where its mesh is
//! available.

use crate::harness::real_meshes::meshes;
use std::path::Path;

use palpate::{Flags, Options, Scene, Simulation, StepReport};

/// Upper bound of the largest change of the force in a step while the tool presses, relative to the median change in a
/// step. The largest change comes at the first touch and is about twice the median; a contact that appears or vanishes
/// abruptly would change the force far more.
const JUMP: f64 = 4.0;
/// Number of steps over which the force is averaged; this mean must never fall while the haptic device moves inwards.
const WINDOW: usize = 5;

/// Runs a press at constant speed and checks that the force is zero before the first contact and then rises smoothly,
/// and that no step has a flag.
fn judge(name: &str, scene: &Scene, steps: usize) {
    // Vulkan validation is left off: it would slow these long runs down too much.
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Options::of_program() };
    let mut simulation = Simulation::open(scene, &options).unwrap();
    let rows: Vec<StepReport> = (0..steps).map(|_| simulation.step().unwrap()).collect();
    let force: Vec<f64> = rows.iter().map(|row| row.tool.unwrap().force.length()).collect();
    let touch = rows.iter().position(|row| row.contacts.unwrap() > 0).expect("the tool never touches the head");
    let pressing = &force[touch - 1..];
    let mut changes: Vec<f64> = pressing.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    changes.sort_by(f64::total_cmp);
    let (median, largest) = (changes[changes.len() / 2], changes[changes.len() - 1]);
    let mean: Vec<f64> = pressing.windows(WINDOW).map(|w| w.iter().sum::<f64>() / WINDOW as f64).collect();
    let slope = mean.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    println!(
        "{name}: first contact in step {touch}; {:.3} N and {} contacts at the end; change of the force in a \
         step: median {median:.1e} N, largest {:.2} times the median; least change of the mean force {:.2} times the \
         median; up to {} solver iterations",
        force[steps - 1],
        rows[steps - 1].contacts.unwrap(),
        largest / median,
        slope / median,
        rows.iter().map(|r| r.iterations).max().unwrap()
    );
    let flagged: Vec<(u64, Flags)> =
        rows.iter().map(|r| (r.step, r.flags)).filter(|f| f.1 != Flags::default()).collect();
    assert!(flagged.is_empty(), "{name}: steps with flags, and their flags: {flagged:?}");
    assert!(
        force[..touch].iter().all(|f| *f == 0.0) && force[steps - 1] > 1.0,
        "{name}: there is a force before the first contact, or at most 1 N at the end"
    );
    assert!(largest < JUMP * median && slope > 0.0, "{name}: the force jumps or falls");
}

#[test]
#[ignore = "long: 6 s"]
fn a_press_into_the_default_head_is_smooth() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/touch-head.toml");
    judge("default head", &Scene::load(&file).unwrap(), 300);
}

#[test]
#[ignore = "needs real meshes"]
fn a_press_into_a_scanned_head_is_smooth() {
    let Some(meshes) = meshes() else { return };
    let text = format!(
        // The tool presses on the forehead: between the eyes, lids fold over the eyeballs and raise flag 16 (the skin,
        // that is the surface mesh, is not a height field).
        "[[body]]\nname = \"head\"\nsurface = {:?}\nlayer = {{ cell = 0.015 }}\n\
         material = {{ young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n\
         [[body.core]]\nname = \"skull\"\nmotion = \"fixed\"\nbind = {{ inset = 0.03 }}\n\
         [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.0, 0.08, 0.13]\n\
         [coupling]\nstiffness = 500.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n\
         [drive]\nkeys = [[0.0, 0.0, 0.08, 0.13], [0.3, 0.0, 0.08, 0.10]]\n",
        meshes.join("surf/head.obj")
    );
    judge("scanned head", &crate::scene::whole_step::scene(&text), 300);
}
