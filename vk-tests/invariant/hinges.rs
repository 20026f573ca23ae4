//! Tests of rigid cores (rigid bodies inside a soft one, to which nodes are attached) and of rigid bodies on hinges:
//! they must turn about the hinge's axis and not move otherwise. Their motion is compared with that of the oracle (the
//! reference implementation in f64), whose copy of the scene is called its twin, and with formulas of mechanics.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer;
use palpate::{Flags, Simulation};
use palpate_oracle as oracle;

use crate::scene::bones::{SHAPE, SPEED, bar, twin_cores};
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

/// Relative tolerance of a pendulum's period, for which the times of zero angle are interpolated between steps of 1 ms.
const PERIOD: f64 = 1e-4;

#[test]
fn a_bar_on_a_hinge_swings_as_the_oracles() {
    // A bar with a dynamic rigid core at either end falls; the left core is on a hinge whose axis does not pass through
    // the centre of the core.
    for young in [2e4, 1e6] {
        let text = bar(young, "[]").replace("motion = \"driven\"\nkeys = []", "motion = \"dynamic\"").replace(
            "name = \"left\"",
            "name = \"left\"\nmotion = \"dynamic\"\nhinge = { point = [-0.09, 0.01, 0.0], axis = [0.0, 3.0, 4.0] }",
        );
        let scene = scene(&text);
        let mut simulation = open(&scene, None);
        let mut twin = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
        twin.bodies.push(soft_twin(&simulation, 0));
        twin.cores = twin_cores(&simulation, 0);
        let start = simulation.frames(0)[0];
        let rows = run(&mut simulation, 80);
        (0..80).for_each(|_| drop(twin.step(None, &[]).unwrap()));
        let (moved, velocities) = simulation.nodes(0).unwrap().unwrap();
        let shape = relative_error(&moved, &twin.bodies[0].displacement);
        let speed = relative_error(&velocities, &twin.bodies[0].velocity);
        let end = simulation.frames(0)[0];
        let turned = (end.rotation * start.rotation.conjugate()).to_scaled_axis();
        let axis = simulation.bodies()[0].orientation * DVec3::new(0.0, 0.6, 0.8);
        let aside = turned.cross(axis).length();
        println!(
            "hinged bar, Young's modulus {young:e} Pa: relative differences from the oracle are {shape:.1e} for \
             displacements, {speed:.1e} for velocities; the hinged core turned by {:.3} rad, {aside:.1e} rad of this \
             about other axes; up to {} solver iterations in a step",
            turned.length(),
            rows.iter().map(|r| r.iterations).max().unwrap()
        );
        assert!(rows.iter().all(|row| row.flags == Flags::default()));
        assert!(
            shape < SHAPE && speed < SPEED && turned.length() > 0.05,
            "relative differences from the oracle: displacements {shape:e}, velocities {speed:e}"
        );
        assert!(
            end.centre == start.centre && aside < 1e-12,
            "the hinged core moved by {} m and turned by {aside:e} rad about other axes than the hinge's",
            end.centre - start.centre
        );
    }
}

/// Half extents of a rigid slab, m, and its mass, kg.
const SLAB: (DVec3, f64) = (DVec3::new(0.02, 0.1, 0.03), 0.2);

/// A rigid slab on a hinge along z near one of its ends. `table` is further text of the table `[step]` of the scene
/// file; `more` is further text of the slab's table and text of tables after it.
fn slab(table: &str, more: &str) -> Simulation {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("slab.obj");
    let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(-SLAB.0, SLAB.0, [4, 20, 6]));
    palpate::scene::obj::write(&mut std::fs::File::create(&file).unwrap(), &vertices, &triangles).unwrap();
    open(
        &scene(&format!(
            "[step]\n{table}\n[[body]]\nname = \"slab\"\nsurface = {file:?}\nmotion = \"dynamic\"\nmass = {:?}\n\
             hinge = {{ point = [0.0, 0.08, 0.01], axis = [0.0, 0.0, 1.0] }}\n{more}\n",
            SLAB.1
        )),
        None,
    )
}

/// Moment of inertia of the slab about its hinge, kg m^2.
fn moment() -> f64 {
    let (half, mass) = SLAB;
    mass * ((half.x * half.x + half.y * half.y) / 3.0 + 0.08 * 0.08)
}

/// Angle by which the slab is turned about z, rad.
fn angle(simulation: &Simulation) -> f64 {
    let DQuat { z, w, .. } = simulation.frames(0)[0].rotation;
    2.0 * z.atan2(w)
}

#[test]
fn a_hinged_slab_is_a_pendulum() {
    let start = 0.1f64;
    let place = format!(
        "orientation = [0.0, 0.0, {:?}, {:?}]\nposition = [3.0, 2.0, 1.0]",
        (start / 2.0).sin(),
        (start / 2.0).cos()
    );
    let h = 0.001;
    let mut simulation = slab("", &place);
    let hinge = simulation.frames(0)[0].centre;
    let energy = |angle: f64, spin: f64| 0.5 * moment() * spin * spin - SLAB.1 * 9.81 * 0.08 * angle.cos();
    let (first, swing) = (energy(start, 0.0), SLAB.1 * 9.81 * 0.08 * (1.0 - start.cos()));
    let (mut last, mut most, mut crossings) = (angle(&simulation), f64::NEG_INFINITY, vec![]);
    let steps = 1500;
    for step in 1..=steps {
        run(&mut simulation, 1);
        let now = angle(&simulation);
        most = most.max((energy(now, (now - last) / h) - first) / swing);
        if now * last < 0.0 {
            crossings.push(h * (f64::from(step) - now / (now - last)));
        }
        last = now;
    }
    let period = 2.0 * (crossings[2] - crossings[0]) / 2.0;
    // `want` is the period of a pendulum with an amplitude of 0.1 rad. Gravity's torque is taken at the start of each
    // step, so that the energy deviates periodically by up to the fraction omega h / 2 of the swing's energy (omega:
    // angular frequency, h: time step); the deviation does not grow.
    let want = TAU * (moment() / (SLAB.1 * 9.81 * 0.08)).sqrt() * (1.0 + start * start / 16.0);
    println!(
        "pendulum: period {period:.4} s, expected {want:.4} s; its energy exceeds its initial energy by at most the \
         fraction {most:.1e} of the energy of the swing"
    );
    assert!(
        (period / want - 1.0).abs() < PERIOD && most < 1.05 * 0.5 * h * TAU / want,
        "period {period} s, expected {want} s; relative gain of energy {most:e}"
    );
    assert!(simulation.frames(0)[0].centre == hinge, "the slab's point on the hinge moved");
}

#[test]
fn a_hinged_slab_that_is_struck_turns_about_its_hinge_and_keeps_its_spin() {
    // A ball (the tool), which no haptic device holds, flies obliquely at the slab's lower end.
    let ball = "[contact]\nstiffness = 1e8\n[tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.035, -0.07, 0.005]\nvelocity = [-0.5, 0.1, 0.2]";
    let mut simulation = slab("gravity = [0.0, 0.0, 0.0]", ball);
    let start = simulation.frames(0)[0];
    let about_hinge = |simulation: &Simulation| {
        let tool = simulation.tool().unwrap();
        let spin = DMat3::from_quat(tool.orientation)
            * tool.inertia
            * DMat3::from_quat(tool.orientation).transpose()
            * tool.angular_velocity;
        ((tool.centre - start.centre).cross(tool.mass * tool.velocity) + spin).z
    };
    let before = about_hinge(&simulation);
    let rows = run(&mut simulation, 60);
    assert!(rows.iter().all(|row| row.flags == Flags::default()));
    let touched = rows.iter().filter(|row| row.contacts.unwrap() > 0).count();
    let after = about_hinge(&simulation);
    let one = angle(&simulation);
    run(&mut simulation, 1);
    let spin = (angle(&simulation) - one) / 0.001;
    run(&mut simulation, 100);
    let two = angle(&simulation);
    run(&mut simulation, 1);
    let later = (angle(&simulation) - two) / 0.001;
    let kept = (after + moment() * spin) / before - 1.0;
    let end = simulation.frames(0)[0];
    println!(
        "struck slab: {touched} steps in contact, then an angular velocity of {spin:.3} rad/s, of which 100 steps lost \
         the fraction {:.1e}; relative change of angular momentum {kept:.1e}",
        1.0 - later / spin
    );
    assert!(
        touched > 2 && spin.abs() > 1.0 && (later / spin - 1.0).abs() < 1e-9 && kept.abs() < 1e-4,
        "relative change of angular momentum {kept:e}"
    );
    assert!(
        end.centre == start.centre && end.rotation.x == 0.0 && end.rotation.y == 0.0,
        "the slab left its hinge's axis: {end:?}"
    );
}
