//! The pressures and friction stresses that contacts report for the end of the step, times the contacts' areas, must
//! sum to the contact force on the tool, the rigid body that the haptic device leads.

use std::path::Path;

use glam::DVec3;
use palpate::{Options, Scene, Simulation};

/// Greatest allowed error of the contacts' total force, relative to the summed magnitudes of the contact forces: f32
/// rounding in a sum of up to a thousand forces.
const ROUNDED: f64 = 1e-5;

/// Text of a scene of a ball, the tool, that is pressed 4 mm into a block and pulled along it.
const SLIDING: &str = "\
[contact]\nfriction = 0.5\n\
[[body]]\nname = \"block\"\nlayer = { box = [[-0.03, -0.02, -0.03], [0.03, 0.0, 0.03]], cells = [8, 4, 8] }\n\
material = { young = 2e4, poisson = 0.4, density = 1000.0 }\n\
[[body.core]]\nname = \"table\"\nmotion = \"fixed\"\nbind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.019, 1.0]] }\n\
[tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.0, 0.0105, 0.0]\n\
[coupling]\nstiffness = 1000.0\ndamping = 10.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n\
[drive]\nkeys = [[0.0, 0.0, 0.0105, 0.0], [0.03, 0.0, 0.006, 0.0], [0.06, 0.01, 0.006, 0.0]]\n";

/// Total force of the reported contacts on the body with index `held` (the tool, or the body that the virtual coupling,
/// a spring and damper to the haptic device, pulls), N, and the sum of the magnitudes of those contacts' forces, N.
fn summed(simulation: &Simulation, held: usize) -> (DVec3, f64) {
    let (mut force, mut sizes) = (DVec3::ZERO, 0.0);
    for contact in simulation.contacts().unwrap() {
        let own = contact.area * (contact.pressure * contact.normal + contact.friction);
        let sign = match contact.bodies {
            [own, _] if own == held => 1.0,
            [_, other] if other == held => -1.0,
            _ => continue,
        };
        force += sign * own;
        sizes += own.length();
    }
    (force, sizes)
}

/// Runs a scene and checks in each step that the contacts' forces sum to the force on the tool. Returns the largest
/// difference relative to the summed magnitudes of contact forces, and the largest force on the tool, N.
fn worst(file: &Path, steps: usize) -> (f64, f64) {
    let scene = Scene::load(file).unwrap();
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let mut simulation = Simulation::open(&scene, &Options { device, ..Options::of_program() }).unwrap();
    let held = scene.tool_body_index().unwrap_or(scene.bodies.len());
    let (mut error, mut largest) = (0.0f64, 0.0f64);
    for _ in 0..steps {
        let report = simulation.step().unwrap();
        let Some(tool) = report.tool else { continue };
        let (force, sizes) = summed(&simulation, held);
        largest = largest.max(tool.force.length());
        let off = (force - tool.force).length();
        assert!(
            off <= ROUNDED * sizes,
            "{}: contacts sum to {force} N, the force on the tool is {} N",
            file.display(),
            tool.force
        );
        error = error.max(off / sizes.max(f64::MIN_POSITIVE));
    }
    (error, largest)
}

/// Runs a scene that comes with the program and makes the checks of `worst`. Returns the largest force on the tool, N.
fn expect_the_wrench(name: &str, steps: usize) -> f64 {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("assets/scenes/{name}.toml"));
    let (error, largest) = worst(&file, steps);
    println!(
        "{name}: error {error:.1e}, relative to the summed sizes of contact forces; tool force up to {largest:.3} N"
    );
    largest
}

#[test]
fn contacts_of_a_touched_head_sum_to_the_wrench() {
    assert!(expect_the_wrench("touch-head", 60) > 0.01);
}

#[test]
fn contacts_with_friction_sum_to_the_wrench() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, SLIDING).unwrap();
    let (error, largest) = worst(&file, 60);
    assert!(largest > 0.05, "largest tool force {largest} N, relative error {error:e}");
}

#[test]
fn after_a_state_is_taken_up_contacts_say_what_the_step_began_with() {
    // After a saved state is restored, the pressure at the end of the step is not known, so that contacts must report
    // the pressure at the start of the step, and no friction.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, SLIDING).unwrap();
    let scene = Scene::load(&file).unwrap();
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let mut simulation = Simulation::open(&scene, &Options { device, ..Options::of_program() }).unwrap();
    (0..40).for_each(|_| drop(simulation.step().unwrap()));
    let (saved, at_end) = (simulation.save().unwrap(), simulation.contacts().unwrap());
    simulation.restore(&saved).unwrap();
    let (_, records) = simulation.touch().unwrap();
    let begun = simulation.contacts().unwrap();
    assert!(
        !begun.is_empty() && begun.len() == at_end.len(),
        "{} contacts after restoring, {} before",
        begun.len(),
        at_end.len()
    );
    assert!(begun.iter().zip(&at_end).any(|(a, b)| a.pressure != b.pressure));
    for (contact, record) in begun.iter().zip(records.iter().filter(|record| record.stiffness > 0.0)) {
        let push = f64::from(record.stiffness * record.depth) + f64::from(record.damping * record.rate);
        assert!(
            (contact.pressure - push.max(0.0)).abs() <= 1e-6 * push.abs(),
            "not the pressure at the start of the step: {contact:?}"
        );
        assert_eq!(contact.friction, DVec3::ZERO);
    }
}

#[test]
#[ignore = "long: 60 s"]
fn lasting_contacts_of_all_scenes_sum_to_the_wrench() {
    // The scenes of two heads, gears and pumpkins have no tool, and so no wrench to compare contacts with.
    let scenes =
        [("held-pad", 300), ("pose-human", 40), ("press-gear", 40), ("press-pumpkin", 40), ("touch-human", 40)];
    for (name, steps) in scenes {
        let largest = expect_the_wrench(name, steps);
        assert!(largest > 1e-3, "{name}: largest tool force {largest} N");
    }
}
