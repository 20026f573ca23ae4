//! States that are saved and restored: from the restored state on, steps must give the same bits, in the same
//! simulation and in another one that has run other steps before.

use glam::DVec3;
use palpate::Simulation;

use crate::invariant::{friction, motion};
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene};
use crate::scene::{held, joints, supports};

/// Number of steps before the state is saved, and (`AFTER`) number of steps that are compared.
const BEFORE: usize = 30;
const AFTER: usize = 25;

/// The bits of everything that a user can see of the next steps, and of the bodies after them.
fn seen(simulation: &mut Simulation) -> Vec<u64> {
    let mut bits = Vec::new();
    for mut row in run(simulation, AFTER) {
        row.step_us = 0.0;
        let tool = row.tool.map_or([DVec3::ZERO; 3], |tool| [tool.force, tool.torque, tool.tool.position]);
        bits.extend(tool.iter().flat_map(|x| x.to_array()).map(f64::to_bits));
        bits.extend([row.step, u64::from(row.iterations), row.residual.to_bits(), u64::from(row.flags.0)]);
        bits.extend([u64::from(row.contacts.unwrap_or_default()), row.time.to_bits()]);
    }
    for body in 0..simulation.bodies().len() {
        let (moved, velocity) = simulation.nodes(body).unwrap().unwrap_or_default();
        bits.extend(moved.iter().chain(&velocity).flat_map(|x| x.to_array()).map(f64::to_bits));
        bits.extend(simulation.frames(body).iter().flat_map(|place| place.centre.to_array()).map(f64::to_bits));
    }
    bits
}

fn goes_on_as_before(name: &str, text: &str) {
    let scene = scene(text);
    let mut simulation = open(&scene, None);
    run(&mut simulation, BEFORE);
    let state = simulation.save().unwrap();
    let first = seen(&mut simulation);
    simulation.restore(&state).unwrap();
    assert_eq!(simulation.save().unwrap(), state, "{name}: the restored state is not the one that was saved");
    assert!(seen(&mut simulation) == first, "{name}: other results after restoring in the same simulation");
    // The other simulation has run more steps, so that its bodies are elsewhere and have other contacts.
    let mut other = open(&scene, None);
    run(&mut other, BEFORE + 9);
    other.restore(&state).unwrap();
    assert!(seen(&mut other) == first, "{name}: other results after restoring in another simulation");
    // The next steps start from a later state and must give other bits; this shows that the comparison can fail.
    assert!(seen(&mut other) != first, "{name}: later steps gave the same bits");
    println!("{name}: the saved state has {} bytes", state.len());
}

#[test]
#[ignore = "long: 7 s"]
fn a_pressed_block_goes_on_as_before() {
    let place = Place { slide: DVec3::new(0.004, 0.0, 0.002), ..Place::default() };
    goes_on_as_before("pressed", &press(2e4, 1e-3, place, "tolerance = 1e-4"));
    let rubbed = press(2e4, 1e-3, place, "tolerance = 1e-4\n[contact]\nfriction = 0.5");
    goes_on_as_before("rubbed", &rubbed);
    let stiff = press(1e6, 1e-3, place, "preconditioner = \"coarse\"");
    goes_on_as_before("with a coarse space", &stiff);
}

#[test]
#[ignore = "long: 15 s"]
fn free_bodies_cores_and_joints_go_on_as_before() {
    goes_on_as_before("two free blocks", &friction::collision(0.3));
    let ball = "mass = 0.02\nposition = [0.005, 0.0385, 0.0]\nvelocity = [0.0, -1.0, 0.0]";
    goes_on_as_before("struck", &motion::struck(motion::BLOCK, 2e4, "auto", ball));
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703], \
                [0.2, 0.42, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    goes_on_as_before("a chain", &joints::chain(2e4, keys, ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]"));
    let newton = "dt = 0.004\nnewton = 3";
    goes_on_as_before("three Newton iterations", &joints::chain(2e4, "motion = \"dynamic\"", ["", ""], newton));
    let coupling = "stiffness = 1000.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.002";
    goes_on_as_before("supported", &supports::held_block("corotational", 1, ""));
    goes_on_as_before("held", &held::pad(5e4, coupling, "", DVec3::ZERO, held::START));
}

#[test]
fn a_state_of_other_bodies_or_damaged_is_refused_and_nothing_changes() {
    let mut block = open(&scene(&press(2e4, 1e-3, Place::default(), "")), None);
    run(&mut block, 3);
    let state = block.save().unwrap();
    let finer = press(2e4, 1e-3, Place::default(), "").replace("cells = [8, 5, 8]", "cells = [8, 5, 9]");
    let mut finer = open(&scene(&finer), None);
    let before = finer.save().unwrap();
    let refused = |simulation: &mut Simulation, bytes: &[u8], words: &str| {
        let error = simulation.restore(bytes).unwrap_err().to_string();
        assert!(error.contains(words) && error.lines().count() == 1, "unexpected error message: {error}");
    };
    refused(&mut finer, &state, "to other bodies");
    refused(&mut finer, b"", "was not saved by this version");
    refused(&mut finer, &state[..20], "cut short");
    for at in [8, 40, 41, state.len() / 2, state.len() - 1] {
        let mut damaged = state.clone();
        damaged[at] ^= 1;
        refused(&mut finer, &damaged, "damaged");
    }
    refused(&mut finer, &[&state[..], &[0]].concat(), "damaged");
    assert_eq!(finer.save().unwrap(), before);
}
