//! Changes, between two steps, of materials, of the contact law (pressure as a function of depth) and of the motion of
//! driven cores (rigid bodies inside a soft one, to which nodes are attached and which move as keys, poses at given
//! times, say). From the change on, a simulation must give the same bits as one that was opened with the change in its
//! scene and into which the state before the change was restored.

use std::time::Duration;

use glam::{DQuat, DVec3};
use palpate::internal::prepare::Shape;
use palpate::scene::Material;
use palpate::{Pose, Scene, Simulation};
use palpate_oracle::contact_law::auto_stiffness;

use crate::invariant::friction;
use crate::scene::joints;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene};

/// Number of steps before the change.
const BEFORE: usize = 25;
/// Number of steps after the change.
const AFTER: usize = 15;

/// Runs the next steps. Returns, as bits, the force on the tool, the number of solver iterations, the residual and the
/// flags of each step, and the node displacements after the last step.
fn seen(simulation: &mut Simulation) -> Vec<u64> {
    let mut bits = Vec::new();
    for row in run(simulation, AFTER) {
        let force = row.tool.map_or(DVec3::ZERO, |tool| tool.force);
        bits.extend(force.to_array().map(f64::to_bits));
        bits.extend([u64::from(row.iterations), row.residual.to_bits(), u64::from(row.flags.0)]);
    }
    for body in 0..simulation.bodies().len() {
        let (moved, _) = simulation.nodes(body).unwrap().unwrap_or_default();
        bits.extend(moved.iter().flat_map(|x| x.to_array()).map(f64::to_bits));
    }
    bits
}

/// Checks that `change` makes a simulation of the scene `first` go on exactly as one of the scene `second` would.
fn becomes(name: &str, first: &str, second: &str, change: impl Fn(&mut Simulation, &Scene)) {
    let (first, second) = (scene(first), scene(second));
    let [mut changed, mut unchanged] = [(); 2].map(|()| open(&first, None));
    run(&mut changed, BEFORE);
    let state = changed.save().unwrap();
    unchanged.restore(&state).unwrap();
    change(&mut changed, &second);
    let mut made = open(&second, None);
    made.restore(&state).unwrap();
    let told = seen(&mut changed);
    assert!(told == seen(&mut made), "{name}: results differ from a simulation that was opened with the change");
    assert!(told != seen(&mut unchanged), "{name}: the change has no effect");
}

fn material_of(scene: &Scene) -> Material {
    scene.bodies[0].material.unwrap()
}

#[test]
#[ignore = "long: 10 s"]
fn another_material_is_felt_at_once() {
    let text = |solver: &str, material: &str| {
        let old = "material = { young = 2e4, poisson = 0.45, density = 1000.0 }";
        let text = press(2e4, 1e-3, Place::default(), solver);
        assert!(text.contains(old));
        text.replace(old, &format!("material = {{ {material} }}"))
    };
    let plain = "young = 2e4, poisson = 0.45, density = 1000.0";
    let other = "young = 6e4, poisson = 0.3, density = 1500.0, damping_mass = 3.0, damping_stiffness = 0.003";
    let change = |simulation: &mut Simulation, to: &Scene| simulation.set_material(0, 0, material_of(to)).unwrap();
    let jacobi = "preconditioner = \"jacobi\"";
    becomes(jacobi, &text(jacobi, plain), &text(jacobi, other), change);
    // The coarse space of the two-level preconditioner is built on aggregates, clusters of nodes that depend on element
    // sizes. These are computed from the masses of nodes, so that with another density, even a uniform one, rounding
    // may give a new simulation other aggregates. So this change keeps the density.
    let (coarse, as_heavy) = ("preconditioner = \"coarse\"", other.replace("1500", "1000"));
    becomes(coarse, &text(coarse, plain), &text(coarse, &as_heavy), change);
    let patches =
        |material: &str| text("", material).replace("name = \"block\"\n", "name = \"block\"\ndilatation = \"patch\"\n");
    becomes("patches", &patches(plain), &patches(other), change);
}

#[test]
#[ignore = "long: 6 s"]
fn another_material_of_free_and_jointed_bodies_is_felt_at_once() {
    let change = |simulation: &mut Simulation, to: &Scene| simulation.set_material(0, 0, material_of(to)).unwrap();
    // The scene names the preconditioner, since by default the engine chooses one by the material.
    let jacobi = |text: String| text.replacen("[solver]\n", "[solver]\npreconditioner = \"jacobi\"\n", 1);
    let free = jacobi(friction::collision(0.0));
    let heavier = free.replacen(
        "young = 3e4, poisson = 0.4, density = 1000.0",
        "young = 1e4, poisson = 0.1, density = 2000.0",
        1,
    );
    assert_ne!(free, heavier);
    becomes("free", &free, &heavier, change);
    let chain = |young: f64, density: &str| {
        let chain = joints::chain(young, "", ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]");
        jacobi(chain.replace("density = 1000.0", density))
    };
    becomes("jointed", &chain(2e4, "density = 1000.0"), &chain(1e5, "density = 700.0"), change);
}

#[test]
#[ignore = "long: 10 s"]
fn another_contact_law_is_felt_at_once() {
    let place = Place { slide: DVec3::new(0.004, 0.0, 0.002), ..Place::default() };
    let text = |contact: &str| press(2e4, 1e-3, place, &format!("tolerance = 1e-4\n[contact]\n{contact}"));
    let change = |simulation: &mut Simulation, to: &Scene| simulation.set_contact(&to.contact).unwrap();
    becomes("stiffer", &text(""), &text("stiffness = 2e8\ndamping = 1e4"), change);
    becomes("rougher", &text("friction = 0.2"), &text("friction = 0.8\nfriction_speed = 0.01"), change);
    becomes("friction where there was none", &text(""), &text("friction = 0.5"), change);
    becomes("stiffness by default again", &text("stiffness = 2e8"), &text(""), change);
}

#[test]
fn contact_of_a_tip_is_stiffer_unless_the_stiffness_is_given() {
    let of = |contact: &str| {
        let text = "[[body]]\nname = \"block\"\nlayer = { box = [[-0.04, -0.04, -0.04], [0.04, 0.0, 0.04]], \
            cells = [6, 3, 6] }\nmaterial = { young = 2e4, poisson = 0.4, density = 1000.0 }\n[[body.core]]\n\
            name = \"table\"\nbind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.039, 1.0]] }\n\
            [tool]\nsphere = 0.003\nmass = 0.05\nposition = [0.003, 0.002, 0.001]\n";
        scene(&format!("[contact]\nsamples = \"triangles\"\n{contact}\n{text}"))
    };
    let (automatic, given) = (of(""), of("stiffness = 4194304.0\ndamping = 128.0"));
    let mut simulation = open(&automatic, None);
    let Shape::Soft { layer, materials, .. } = &simulation.bodies()[0].shape else { panic!("the block is rigid") };
    let plain = auto_stiffness(&[(layer, &materials.all[0])]).unwrap() as f32;
    let laws = |simulation: &mut Simulation| -> Vec<[f32; 2]> {
        run(simulation, 1);
        let pressing = simulation.touch().unwrap().1.into_iter().filter(|contact| contact.stiffness != 0.0);
        pressing.map(|contact| [contact.stiffness, contact.damping]).collect()
    };
    // The sphere fills a part of a cell: the contact's stiffness and damping have a factor between 1 and 16.
    let is_tip = |[stiffness, damping]: &[f32; 2]| {
        let factor = stiffness / plain;
        factor > 1.5 && factor <= 16.0 && (damping / (1e-3 * stiffness) - 1.0).abs() < 1e-5
    };
    let first = laws(&mut simulation);
    assert!(!first.is_empty() && first.iter().all(is_tip), "automatic: {first:?} where a face has {plain}");
    simulation.set_contact(&given.contact).unwrap();
    let then = laws(&mut simulation);
    assert!(!then.is_empty() && then.iter().all(|law| *law == [4194304.0, 128.0]), "given: {then:?}");
    simulation.set_contact(&automatic.contact).unwrap();
    let again = laws(&mut simulation);
    assert!(!again.is_empty() && again.iter().all(is_tip), "automatic again: {again:?}");
}

#[test]
fn a_kinematic_core_goes_where_it_is_sent_and_stays() {
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    let mut simulation = open(&scene(&joints::chain(2e4, keys, ["", ""], "gravity = [0.0, 0.0, 0.0]")), None);
    let root = 1;
    let start = simulation.core_pose(0, root).unwrap();
    assert!(start.position.distance(DVec3::new(0.4, 0.1, -0.2)) < 1e-12, "the core starts at {start:?}");
    let pose =
        Pose { position: DVec3::new(0.41, 0.1, -0.21), orientation: DQuat::from_rotation_y(0.05) * start.orientation };
    simulation.move_core(0, root, pose, Duration::from_millis(20)).unwrap();
    run(&mut simulation, 10);
    let half = simulation.core_pose(0, root).unwrap();
    assert!(
        half.position.distance(start.position.midpoint(pose.position)) < 1e-9,
        "the core is not halfway after half the time: {half:?}"
    );
    run(&mut simulation, 20);
    let end = simulation.core_pose(0, root).unwrap();
    assert!(end.position.distance(pose.position) < 1e-9, "the core's position at the end: {end:?}");
    assert!(end.orientation.angle_between(pose.orientation) < 1e-6, "the core's orientation at the end: {end:?}");
    let refused = simulation.move_core(0, 0, pose, Duration::ZERO).unwrap_err().to_string();
    assert!(refused.contains("core 0 of body 0 is not driven"), "unexpected error message: {refused}");
    assert!(simulation.move_core(0, 7, pose, Duration::ZERO).is_err() && simulation.core_pose(3, 0).is_none());
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let first = scene(&press(2e4, 1e-3, Place::default(), ""));
    let mut simulation = open(&first, None);
    let good = material_of(&first);
    let wrong = [
        (Material { young: 0.0, ..good }, "material.young is 0.0"),
        (Material { young: f64::NAN, ..good }, "material.young is NaN"),
        (Material { poisson: 0.5, ..good }, "material.poisson is 0.5"),
        (Material { density: -1.0, ..good }, "material.density is -1.0"),
        (Material { damping_mass: f64::INFINITY, ..good }, "material.damping_mass is inf"),
        (Material { law: palpate::scene::MaterialLaw::NeoHookean, ..good }, "material.law"),
    ];
    for (material, words) in wrong {
        let error = simulation.set_material(0, 0, material).unwrap_err().to_string();
        assert!(error.contains(words), "unexpected error message: {error}");
    }
    assert!(simulation.set_material(0, 1, good).is_err() && simulation.set_material(1, 0, good).is_err());
    let mut law = first.contact.clone();
    law.friction = -0.1;
    let error = simulation.set_contact(&law).unwrap_err().to_string();
    assert!(error.contains("contact.friction is -0.1"), "unexpected error message: {error}");
    let mut untouched = open(&first, None);
    assert_eq!(seen(&mut simulation), seen(&mut untouched));
}
