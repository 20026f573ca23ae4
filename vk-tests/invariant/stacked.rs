//! Blocks stacked on each other: what lies flat is pushed straight up. The rims of the two faces are where contact
//! normals go wrong first: there the walls of the blocks count too, and few vertices decide.

use glam::DVec3;
use palpate::Flags;

use crate::scene::whole_step::{open, run, scene};

const GRAVITY: f64 = 9.81;
/// Steps of 1 ms over which the mean force is taken.
const WINDOW: usize = 100;
/// Greatest sideways force, as a share of the weight.
const SIDEWAYS: f64 = 0.01;
/// How far aside a block may be for its force to count, m. Without friction a block that lies aside sinks in deeper there
/// and slides down that slope, faster and faster, as it would on any soft body.
const ASIDE: f64 = 0.009;
/// How far friction may let a block move, m.
const HELD: f64 = 0.001;

/// A block that is dropped on another.
struct Case {
    /// Half its width, m; that of the lower block is 0.03.
    half: f64,
    /// Its turn about the vertical, degrees.
    turn: f64,
    /// How far aside it is dropped, m.
    aside: f64,
    /// Coefficient of friction.
    friction: f64,
}

#[test]
#[ignore = "long: 20 s"]
fn a_block_on_a_block_is_pushed_straight_up() {
    // The upper block falls by 2 mm and comes to rest.
    for (half, turn, aside, friction) in [
        (0.03, 0.0, 0.0, 0.0),
        (0.03, 0.0, 5e-4, 0.0),
        (0.03, 20.0, 0.0, 0.0),
        (0.02, 0.0, 0.0, 0.0),
        (0.03, 0.0, 0.0, 0.3),
    ] {
        stack(400, &Case { half, turn, aside, friction });
    }
}

#[test]
#[ignore = "long: 70 s"]
fn lasting_a_block_on_a_block_is_pushed_straight_up_in_two_thousand_steps() {
    for friction in [0.0, 0.3] {
        for (half, turn) in [(0.03, 0.0), (0.03, 20.0), (0.03, 45.0), (0.02, 0.0), (0.02, 45.0)] {
            stack(2000, &Case { half, turn, aside: 0.0, friction });
        }
    }
}

/// Drops a block on a block and does `steps` steps of 1 ms.
fn stack(steps: usize, Case { half, turn, aside, friction }: &Case) {
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
    let level = |x: DVec3| x * DVec3::new(1.0, 0.0, 1.0);
    let mut places = vec![level(simulation.frames(1)[0].centre)];
    let mut flagged = None;
    let mut is_touched = false;
    for _ in 0..steps / WINDOW {
        for row in run(&mut simulation, WINDOW) {
            flagged = flagged.or((row.flags != Flags::default()).then_some((row.step, row.flags)));
            is_touched |= row.contacts.unwrap() > 0;
        }
        places.push(level(simulation.frames(1)[0].centre));
    }
    let moved: Vec<f64> = places.iter().map(|x| x.distance(places[0])).collect();
    let seconds = 1e-3 * WINDOW as f64;
    // Mean accelerations, from three places each, over that of gravity.
    let shares = places.windows(3).map(|x| (x[2] - 2.0 * x[1] + x[0]).length() / (seconds * seconds) / GRAVITY);
    let counted: Vec<f64> =
        shares.zip(&moved[2..]).take_while(|(_, moved)| **moved < ASIDE).map(|(share, _)| share).collect();
    let most = counted.iter().copied().fold(0.0, f64::max);
    let end = moved[moved.len() - 1];
    println!(
        "half width {half} m, turned {turn} degrees, {aside} m aside, friction {friction}: at most {most:.1e} of the weight \
         in {} windows; {end:.1e} m aside at the end",
        counted.len()
    );
    assert!(is_touched && counted.len() >= 3, "only {} windows count", counted.len());
    assert!(most < SIDEWAYS, "the block was pushed sideways by {most:.1e} of its weight");
    assert!(*friction == 0.0 || end < HELD, "friction let the block move by {end} m");
    if *turn == 0.0 && *aside == 0.0 && end < ASIDE {
        assert!(flagged.is_none(), "a step of aligned blocks was flagged: {flagged:?}");
    }
}
