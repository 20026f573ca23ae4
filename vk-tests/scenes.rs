//! The paper's scenes of two soft bodies, as they come with the program: their first steps, which must be sound. What they
//! do later is too long for a test.

use std::path::Path;

use palpate::gpu::Options;
use palpate::report::Flags;
use palpate::scene::Scene;
use palpate::step::Simulation;

/// Steps of a millisecond.
const STEPS: usize = 5;

fn starts(name: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes").join(name);
    // Validation is for the small scenes: these are large.
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), validation: false };
    let mut simulation = Simulation::new(&Scene::load(&file).unwrap(), &options, None).unwrap();
    for _ in 0..STEPS {
        let row = simulation.step().unwrap();
        assert_eq!(row.flags, Flags::default(), "{name}: step {}", row.step);
        assert!(row.probes.iter().all(|x| x.is_finite()) && row.residual < 1e-3, "{name}: {row:?}");
    }
    for body in 0..simulation.bodies().len() {
        let (moved, velocity) = simulation.nodes(body).unwrap().unwrap();
        // Nothing falls faster than it must, or flies off.
        let most = |x: &[glam::DVec3]| x.iter().map(|x| x.length()).fold(0.0, f64::max);
        assert!(most(&moved) < 0.002 && most(&velocity) < 0.3, "{name}: {} m, {} m/s", most(&moved), most(&velocity));
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
