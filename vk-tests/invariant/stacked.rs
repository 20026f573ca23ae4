//! Blocks stacked on each other: what lies flat is pushed straight up. The rims of the two faces are where contact
//! normals go wrong first: there the walls of the blocks count too, and few vertices decide.

use glam::DVec3;
use palpate::Flags;

use crate::scene::whole_step::{open, run, scene};

const GRAVITY: f64 = 9.81;
/// Number of steps of 1 ms, in which the upper block falls by 2 mm and comes to rest.
const STEPS: usize = 400;
/// Greatest sideways force, as a share of the weight.
const SIDEWAYS: f64 = 0.01;

#[test]
#[ignore = "long: 20 s"]
fn a_block_on_a_block_is_pushed_straight_up() {
    for (half, turn, aside, friction) in [
        (0.03, 0.0, 0.0, 0.0),
        (0.03, 0.0, 5e-4, 0.0),
        (0.03, 20f64, 0.0, 0.0),
        (0.02, 0.0, 0.0, 0.0),
        (0.03, 0.0, 0.0, 0.3),
    ] {
        let (sin, cos) = (0.5 * turn.to_radians()).sin_cos();
        let material = "material = { young = 2e4, poisson = 0.4, density = 1000.0, damping_mass = 2.0 }";
        let text = format!(
            "[contact]\nfriction = {friction:?}\n[[body]]\nname = \"lower\"\n\
             layer = {{ box = [[-0.03, -0.04, -0.03], [0.03, 0.0, 0.03]], cells = [6, 4, 6] }}\n{material}\n\
             [[body.core]]\nname = \"floor\"\nbind = {{ box = [[-0.04, -0.05, -0.04], [0.04, -0.039, 0.04]] }}\n\
             [[body]]\nname = \"upper\"\nposition = [{aside:?}, 0.002, 0.0]\norientation = [0.0, {sin:?}, 0.0, {cos:?}]\n\
             layer = {{ box = [[{0:?}, 0.0, {0:?}], [{half:?}, 0.04, {half:?}]], cells = [6, 4, 6] }}\n{material}\n",
            -half
        );
        let mut simulation = open(&scene(&text), None);
        let start = simulation.frames(1)[0].centre;
        let rows = run(&mut simulation, STEPS);
        let touched = rows.iter().position(|row| row.contacts.unwrap() > 0).unwrap();
        let moved = (simulation.frames(1)[0].centre - start) * DVec3::new(1.0, 0.0, 1.0);
        // The mean acceleration of what started at rest.
        let seconds = 1e-3 * (STEPS - touched) as f64;
        let share = 2.0 * moved.length() / (seconds * seconds) / GRAVITY;
        println!(
            "half width {half} m, turned {turn} degrees, {aside} m aside, friction {friction}: {share:.1e} of the weight"
        );
        assert!(
            share < SIDEWAYS,
            "the block was pushed by {moved} m in {seconds} s, {share:.1e} of its weight sideways"
        );
        assert!(rows.last().unwrap().contacts.unwrap() > 0, "the blocks are apart");
        if turn == 0.0 && aside == 0.0 {
            let flagged = rows.iter().find(|row| row.flags != Flags::default()).map(|row| (row.step, row.flags));
            assert!(flagged.is_none(), "a step of aligned blocks was flagged: {flagged:?}");
        }
    }
}
