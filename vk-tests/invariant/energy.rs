//! Tests an invariant, a law that whole steps must keep: contact creates no energy. A rigid sphere (the tool) is
//! dropped on a soft block, a free soft block is dropped on a half-space, and sphere and block are also thrown so that
//! friction acts on them. A contact is a vertex of a body's skin (surface mesh) inside the other body; a penalty spring
//! pushes it out along the normal of the contact patch (the place where two bodies may touch).

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::Flags;
use palpate::internal::shaders::Contact;

use crate::invariant::invariants::{BLOCK, State};
use crate::scene::whole_step::{open, run, scene};

/// Greatest energy that may be gained, relative to the largest change of energy since the start. It is not zero,
/// because positions and velocities are f32, and the solver stops at a relative residual of 1e-6.
const GAIN: f64 = 1.0e-5;

/// Radius of the dropped sphere, m.
const RADIUS: f64 = 0.02;
/// Greatest angle between a facet of the sphere's mesh and the sphere, rad: an edge spans 0.075 rad, and a corner lies
/// 1/sqrt(3) of this angle from the middle of its facet.
const FACET: f64 = 0.044;

/// Penalty energy of each contact of a step, J: the energy stored in its penalty spring. The key is the body of the
/// contact's vertex (`side`: first or second body of the pair) and the index of the vertex. Released contacts, which
/// would pull and whose stiffness the step has set to 0, count too, with the stiffness of the others.
fn penalties(contacts: &[Contact]) -> BTreeMap<(u32, u32), f64> {
    let stiffness = contacts.iter().map(|c| c.stiffness).fold(0.0, f32::max);
    let energy = |c: &Contact| 0.5 * f64::from(stiffness * c.area) * f64::from(c.depth).powi(2);
    contacts.iter().map(|c| ((c.side, c.vertex), energy(c))).collect()
}

/// Runs a drop or throw and checks the energy at the start of each step, with the contacts that the step finds there.
/// The sum of kinetic, elastic and gravitational energy must never exceed its initial value. If the penalty energy of
/// the contacts is added, the sum may rise from one step to the next by two amounts only: the penalty energy of
/// contacts that are new since the last step (their vertices have moved inwards for up to one step before they are
/// found), and the work of a spinning sphere's facets that slide under the contacts. Depth is measured along the normal
/// of the contact patch, and the force acts along it, but the facet is inclined to this normal: sliding on the facet
/// changes the depth and meets no resistance. On a plane there is no such work.
fn judge(name: &str, text: &str, steps: usize, height: impl Fn(&State) -> f64) {
    let scene = scene(text);
    let mut simulation = open(&scene, None);
    let (mut energies, mut heights) = (Vec::new(), Vec::new());
    let (mut last, mut sum, mut rise, mut most) = (BTreeMap::new(), f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
    let mut sliding = 0.0;
    for _ in 0..steps {
        let state = State::of(&simulation);
        let row = run(&mut simulation, 1).remove(0);
        assert_eq!(row.flags, Flags::default(), "{name}: flags of step {}", row.step);
        let energy = state.energy(scene.step.gravity);
        let stored = penalties(&simulation.touch().unwrap().1);
        let entered: f64 = stored.iter().filter(|(key, _)| !last.contains_key(*key)).map(|(_, e)| e).sum();
        let total = energy + stored.values().sum::<f64>();
        rise = rise.max(total - entered - sliding - sum);
        let spin = simulation.tool().map_or(0.0, |tool| tool.angular_velocity.length());
        sliding = row.tool.map_or(0.0, |tool| tool.force.length() * spin * RADIUS * FACET * scene.step.dt);
        most = most.max(stored.values().sum());
        (last, sum) = (stored, total);
        energies.push(energy);
        heights.push(height(&state));
    }
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let at = heights.iter().position(|h| *h == lowest).unwrap();
    let rebound = heights[at..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let scale = energies.iter().map(|e| (e - energies[0]).abs()).fold(0.0, f64::max);
    let gain = energies[1..].iter().map(|e| e - energies[0]).fold(f64::NEG_INFINITY, f64::max);
    println!(
        "{name}: energy changed by up to {scale:.2e} J; relative to that, it exceeded its first value by {:.1e}, and \
         with the penalty energy of contacts (up to {most:.1e} J) a step gained up to {:.1e} apart from entering \
         contacts and sliding facets; lowest height {lowest:.4} m at step {at}, then up to {rebound:.4} m, at the \
         start {:.4} m",
        gain / scale,
        rise / scale,
        heights[0]
    );
    assert!(gain < GAIN * scale && rise < GAIN * scale, "{name}: energy was gained beyond the tolerance");
    assert!(
        most > 0.0 && rebound > lowest && rebound < heights[0],
        "{name}: no contact, no rebound, or a rebound above the initial height"
    );
}

#[test]
#[ignore = "long: 13 s"]
fn friction_never_adds_energy() {
    for (friction, young, speed) in [(0.3, 2.0e4, 0.3), (1.0, 1.0e6, 0.5)] {
        let rubs = format!("[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[contact]\nfriction = {friction:?}\n");
        let material = format!("material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n");
        let text = format!(
            "{rubs}[[body]]\nname = \"block\"\nlayer = {{ {BLOCK}, cells = [5, 5, 5] }}\nposition = [0.0, 0.06, 0.0]\n\
             velocity = [{speed:?}, 0.0, 0.1]\n{material}\
             [[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n"
        );
        let height = |s: &State| s.nodes().map(|(m, x, _)| m * x.y).sum::<f64>() / s.nodes().map(|n| n.0).sum::<f64>();
        judge(&format!("block of {young:e} Pa thrown at {speed} m/s, friction {friction}"), &text, 160, height);
        let text = format!(
            "{rubs}[[body]]\nname = \"block\"\nlayer = {{ {BLOCK}, cells = [6, 6, 6] }}\n{material}\
             [[body.core]]\nname = \"c\"\nbind = {{ box = [[-0.06, -0.06, -0.06], [0.06, -0.049, 0.06]] }}\n\
             [tool]\nsphere = {RADIUS:?}\nmass = 0.05\nposition = [-0.02, {:?}, 0.0]\nvelocity = [{speed:?}, 0.0, 0.05]\n",
            0.05 + RADIUS + 0.01
        );
        judge(&format!("tool thrown at {speed} m/s, friction {friction}"), &text, 100, |s| {
            s.tool.as_ref().unwrap().centre.y
        });
    }
}

#[test]
#[ignore = "long: 14 s"]
fn a_dropped_tool_never_gains_energy() {
    for (young, drop, steps) in [(5.0e3, 0.01, 200), (2.0e4, 0.02, 150), (2.0e4, 0.1, 250), (1.0e6, 0.02, 220)] {
        // The penalty energy of a vertex follows from its depth, that of a triangle not from its mean depth.
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[contact]\nsamples = \"vertices\"\n[[body]]\n\
             name = \"block\"\nlayer = {{ {BLOCK}, cells = [6, 6, 6] }}\n\
             material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n[[body.core]]\nname = \"c\"\n\
             motion = \"fixed\"\nbind = {{ box = [[-0.06, -0.06, -0.06], [0.06, -0.049, 0.06]] }}\n\
             [tool]\nsphere = {RADIUS:?}\nmass = 0.05\nposition = [0.0, {:?}, 0.0]\n",
            0.05 + RADIUS + drop
        );
        judge(&format!("tool dropped {drop} m on {young:e} Pa"), &text, steps, |s| s.tool.as_ref().unwrap().centre.y);
    }
}

#[test]
#[ignore = "long: 9 s"]
fn a_dropped_block_never_gains_energy() {
    let cases = [(2.0e4, 0.02, 0.0, 180), (2.0e4, 0.1, 0.0, 270), (1.0e6, 0.02, 0.0, 160), (5.0e4, 0.03, 0.4, 220)];
    for (young, drop, tilt, steps) in cases {
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.0, 0.6).normalize(), tilt).to_array();
        let lowest = 0.05 * DQuat::from_array(turn).conjugate().mul_vec3(DVec3::Y).abs().element_sum();
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
             layer = {{ {BLOCK}, cells = [5, 5, 5] }}\nposition = [0.0, {:?}, 0.0]\norientation = {turn:?}\n\
             material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n\
             [[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n",
            lowest + drop
        );
        let height = |s: &State| s.nodes().map(|(m, x, _)| m * x.y).sum::<f64>() / s.nodes().map(|n| n.0).sum::<f64>();
        judge(&format!("block of {young:e} Pa dropped {drop} m, tilt {tilt} rad"), &text, steps, height);
    }
}
