//! Scenes of two soft bodies that come with the program, after those of the paper whose method it implements. Their
//! first steps must have no flags and no excessive motion. Tests of the later steps take minutes and are run by name
//! (`lasting`). A probe is a point of a body's surface whose path is written down.

use std::path::Path;

use glam::DVec3;
use palpate::{Flags, Options, Scene, Simulation};

/// Twice the residual at which a solver without a tolerance may stop.
const LOOSE: f64 = 0.02;
/// Number of steps, of 1 ms each.
const STEPS: usize = 5;

fn open(name: &str) -> Simulation {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes").join(name);
    // Vulkan validation is left off: it would slow these large scenes down too much.
    let options =
        Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), validation: false, ..Options::of_program() };
    Simulation::open(&Scene::load(&file).unwrap(), &options).unwrap()
}

fn starts(name: &str) {
    let mut simulation = open(name);
    for _ in 0..STEPS {
        let row = simulation.step().unwrap();
        assert_eq!(row.flags, Flags::default(), "{name}: flags in step {}", row.step);
        assert!(
            row.probes.iter().all(|x| x.is_finite()) && row.residual < LOOSE,
            "{name}: a probe is not finite or the residual is too great: {row:?}"
        );
    }
    for body in 0..simulation.bodies().len() {
        let (moved, velocity) = simulation.nodes(body).unwrap().unwrap();
        // Nothing may fall faster than freely, or fly off.
        let most = |x: &[DVec3]| x.iter().map(|x| x.length()).fold(0.0, f64::max);
        assert!(
            most(&moved) < 0.002 && most(&velocity) < 0.3,
            "{name}: displacement up to {} m, velocity up to {} m/s",
            most(&moved),
            most(&velocity)
        );
    }
}

#[test]
fn two_heads_start() {
    starts("two-heads.toml");
}

#[test]
fn gears_start() {
    starts("gears.toml");
}

#[test]
fn pumpkins_start() {
    starts("pumpkins.toml");
}

/// Number of steps of a whole run.
const WHOLE: usize = 300;

/// Runs a scene and checks the contact force between its two bodies. `jump` bounds the change of the force in a step,
/// relative to the greatest force of the run.
fn runs(name: &str, jump: f64) {
    let mut simulation = open(name);
    let (mut force, mut flagged) = (vec![], vec![]);
    for _ in 0..WHOLE {
        let row = simulation.step().unwrap();
        if row.flags != Flags::default() {
            flagged.push((row.step, row.flags.0));
        }
        // The contact force on the first body, N.
        let push = simulation.contacts().unwrap().iter().fold(DVec3::ZERO, |sum, contact| {
            let own = contact.area * (contact.pressure * contact.normal + contact.friction);
            sum + if contact.bodies[0] == 0 { own } else { -own }
        });
        force.push(push);
    }
    let peak = force.iter().map(|f| f.length()).fold(0.0, f64::max);
    let touched = force.iter().filter(|f| f.length() > 0.0).count();
    let mut changes: Vec<f64> = force.windows(2).map(|w| w[0].distance(w[1])).collect();
    changes.sort_by(f64::total_cmp);
    let share = |at: usize| changes[at * (changes.len() - 1) / 100] / peak;
    println!(
        "{name}: {touched} of {WHOLE} steps in contact, force up to {peak:.2} N; change of the force in a step, \
         relative to that force: median {:.4}, 99th percentile {:.3}, largest {:.3}; steps with flags, and their \
         flags {flagged:?}",
        share(50),
        share(99),
        share(100)
    );
    assert!(
        flagged.is_empty() && touched > 200,
        "{name}: {touched} steps in contact; steps with flags, and their flags {flagged:?}"
    );
    assert!(share(100) < jump, "{name}: greatest change of the force in a step, relative to its peak {}", share(100));
}

#[test]
#[ignore = "lasting: takes some minutes"]
fn lasting_two_heads() {
    runs("two-heads.toml", 0.1);
}

#[test]
#[ignore = "lasting: takes some minutes"]
fn lasting_gears() {
    runs("gears.toml", 0.1);
}

#[test]
#[ignore = "lasting: takes some minutes"]
fn lasting_pumpkins() {
    runs("pumpkins.toml", 0.1);
}
