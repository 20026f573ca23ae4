//! Cases of the stability matrix. Each case is one simulation of a soft block, which is released, pressed, stretched or
//! spun, or at which a sphere is thrown. A function for each kind of case sets the scene and the promise: the
//! invariants (conditions that are checked) that this kind must keep besides those of every step. The sphere
//! is the tool, the rigid body that the haptic device leads by a virtual coupling (spring and damper). Some lengths and
//! heights are given in block edges, that is as multiples of the length of the block's edge.

use palpate::scene::MaterialLaw;

use super::invariants::{AT_REST, DRIFT, Promise};
use super::modes;
use super::setup::{Attachment, RADIUS, Setup, Sphere};
use super::trace::HALF_ULP;

/// Least and greatest number of steps in which a case is given time to come to rest. The least number also bounds the
/// number of steps of a press (a sphere is pressed into the block and drawn out) from below.
const STEPS: [f64; 2] = [40.0, 2500.0];
/// Greatest number of steps of a press. A case that would need more than `STEPS[1]` steps to come to rest is also given
/// this number of steps.
const PRESS_STEPS: f64 = 400.0;
/// Greatest number of steps after the sphere of a press has been drawn out.
const AFTER_STEPS: f64 = 1000.0;
/// Number of steps of a case without damping.
const UNDAMPED: f64 = 200.0;
/// Strain to which an undamped free block is stretched before it is released. A block stiffer than the default one is
/// stretched by less, so that its energy is no greater.
const PLUCKED: f64 = 0.1;
/// Product of damping rate and time after which the energy of an oscillation has decayed to about 1e-6 of its first
/// value.
const TO_REST: f64 = 14.0;
/// Duration of a press, s. It has four phases: the sphere goes in, is held, is drawn out, and stays away.
const PRESS: f64 = 0.24;
/// Times at which the first three phases of a press end, as shares of its duration.
const PHASES: [f64; 3] = [0.25, 0.5, 0.65];
/// Depth to which the haptic device goes in a press, in block edges. Depth and height of the device are relative to the
/// place at which the sphere touches the top of the undeformed block.
const DEPTH: f64 = 0.1;
/// Height to which the haptic device goes at the end of a press, and of a jump into the block, in block edges.
const AWAY: f64 = 0.2;

/// Step from which a block that rests on the floor counts as settled.
const SETTLED: usize = 500;
/// How far the centre of a block that nothing can move may be displaced by rounding (see `still`), in block edges.
const STILL: f64 = 1e-9;
/// Greatest distance of a node from its rest position at the end of a case in which the block comes back to rest, in
/// block edges. A block of the default stiffness sags by a fortieth of its edge under its weight; this bound is not
/// promised of a block that a tool touched and that sags by more than half of the bound.
const SHAPE: f64 = 0.1;
/// A thrown sphere bounces off if its mass is at most this share of the block's mass.
const BOUNCES: f64 = 0.2;
/// A thrown sphere goes through the block if its mass is at least this multiple of the block's mass.
const PASSES: f64 = 500.0;
/// Rounding error of a sum over the nodes inside a body, as a multiple of the rounding error of the sum's largest term.
const INSIDE: f64 = 4.0;
/// Speed of the thrown sphere, m/s.
const THROWN: f64 = 0.5;
/// Time, in steps, after which the haptic device of a `teleport` case jumps into the block; after five times this time
/// it jumps back.
const TELEPORTED: f64 = 20.5;

/// Initial state of the block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// At rest, undeformed.
    Rest,
    /// Stretched along y by this factor, with the plane y = 0 in place; a factor below zero turns the block inside out.
    Stretched(f64),
    /// Turning about its centre at this angular speed, rad/s, about an axis that is not an axis of symmetry.
    Spinning(f64),
}

/// One simulation of the matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Name of what is done to the block; it distinguishes the cases that are run for one value of a varied quantity.
    pub scenario: &'static str,
    /// Parameters of the scene.
    pub setup: Setup,
    /// Initial state of the block.
    pub start: Start,
    /// Number of steps.
    pub steps: usize,
    /// Invariants that this case must keep besides those of every step.
    pub promise: Promise,
    /// How long the case has to come to rest; `None`: rest is not promised, or `promise` bounds the remaining energy.
    pub settling: Option<Settling>,
}

/// The number of steps in which a case must come to rest, and how fast the tool's own oscillation decays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settling {
    /// Number of steps that the case has to come to rest; `None`: the number of steps after the last one in which a
    /// contact pressed.
    pub steps: Option<usize>,
    /// Factor by which the velocity of the tool's oscillation on its coupling decays in a step; 0 if no tool with a
    /// coupling is to come to rest.
    pub other: f64,
}

/// The block, attached at its side, is released under gravity.
pub fn hang(setup: Setup) -> Case {
    let setup = Setup { attachment: Attachment::Side, ..setup };
    let steps = damped_steps(&setup);
    let scenario = if setup.material.damping_mass > 0.0 { "hang" } else { "hang, undamped" };
    let settling = Some(Settling { steps: Some(steps), other: 0.0 });
    Case { scenario, setup, start: Start::Rest, steps, promise: Promise::default(), settling }
}

/// Number of steps in which the damping brings the block to rest; a smaller number if that would be too many, or if
/// nothing damps the block.
fn damped_steps(setup: &Setup) -> usize {
    let rate = setup.material.damping_mass;
    let steps = if rate > 0.0 { (TO_REST / rate / setup.dt).ceil() } else { UNDAMPED };
    // A case that would need more steps than the cap `STEPS[1]` would not come to rest within the cap either, so that
    // it is run for fewer steps.
    if steps > STEPS[1] { PRESS_STEPS as usize } else { steps.max(STEPS[0]) as usize }
}

/// The block is stretched and released without attachment, gravity or damping: its centre must stay in place, and its
/// energy must not grow.
pub fn pluck(setup: Setup) -> Case {
    let usual = Setup::default();
    let stiffer = setup.material.young / usual.material.young * usual.edge / setup.edge;
    let stretch = PLUCKED * stiffer.max(1.0).sqrt().recip();
    // In one step no node moves by more than `stretch` block edges. The solver leaves a share of that motion, at most
    // `DRIFT`, unsolved, by which the centre drifts.
    let way = stretch * UNDAMPED;
    let solved = DRIFT * (1.0 + way);
    // The momentum that nodes of the block exchange in a step is rounded too, by which the centre also drifts. That
    // momentum grows with the square of the distance that a wave travels in a step.
    let waves = setup.material.young / setup.material.density * (setup.dt / setup.edge).powi(2);
    let rounded = INSIDE * HALF_ULP * waves * way;
    let promise = Promise { drift: Some((0, (solved + rounded) * setup.edge)), ..Promise::default() };
    let setup = Setup { attachment: Attachment::Nothing, gravity: 0.0, ..setup };
    let (start, steps) = (Start::Stretched(1.0 + stretch), UNDAMPED as usize);
    Case { scenario: "pluck", setup, start, steps, promise, settling: None }
}

/// How far the top of a block sags under its own weight, m.
fn sag(setup: &Setup) -> f64 {
    0.5 * setup.material.density * setup.gravity * setup.edge.powi(2) / setup.material.young
}

/// The promise of a case in which a tool touched the block and left it: a contact presses in some step, and at the end
/// none presses and the block has its rest shape. A block that sags too far promises only that a contact presses.
fn left_alone(setup: &Setup) -> Promise {
    let is_firm = sag(setup) <= 0.5 * SHAPE * setup.edge;
    let (shape, tolerance) =
        (is_firm.then_some(SHAPE * setup.edge), setup.preset.and_then(|preset| preset.tolerance).unwrap_or(0.0));
    Promise { shape, tolerance, touches: true, parts: is_firm, ..Promise::default() }
}

/// A sphere on a virtual coupling is pressed into the block, held, and drawn out.
pub fn press(setup: Setup, sphere: Sphere) -> Case {
    let pressing = (PRESS / setup.dt).round().clamp(STEPS[0], PRESS_STEPS);
    let end = pressing * setup.dt;
    let [down, held, up] = PHASES.map(|phase| phase * end);
    let after = ((1.0 - PHASES[2]) * pressing).max(damped_steps(&setup) as f64).min(AFTER_STEPS);
    let steps = (PHASES[2] * pressing + after).ceil() as usize;
    let gap = 0.02 * setup.edge;
    // If gravity is greater than the default, the top sags further, and the press goes deeper by the difference.
    let usual = Setup { gravity: Setup::default().gravity, ..setup.clone() };
    let sunk = (sag(&setup) - sag(&usual)).clamp(0.0, 0.5 * setup.edge);
    let deep = -DEPTH * setup.edge - sunk;
    let path = vec![(0.0, gap), (down, deep), (held, deep), (up, AWAY * setup.edge)];
    let settling = Some(Settling { steps: Some(after as usize), other: swing(&sphere, setup.dt) });
    let scenario = if setup.material.damping_mass > 0.0 { "press" } else { "press, undamped" };
    let promise = left_alone(&setup);
    let setup = Setup { attachment: Attachment::Bottom, sphere: Some(Sphere { path, ..sphere }), ..setup };
    Case { scenario, setup, start: Start::Rest, steps, promise, settling }
}

/// Factor by which the velocity of a sphere's own oscillation on its coupling decays in a step of `dt` seconds.
fn swing(sphere: &Sphere, dt: f64) -> f64 {
    let (stiffness, damping) = sphere.coupling.unwrap_or((0.0, 0.0));
    modes::decay((stiffness / sphere.mass).sqrt(), damping / sphere.mass, dt)
}

/// A sphere of 50 g on a coupling of 500 N/m and 5 N s/m for the default block, scaled to a block with the edge `edge`
/// (m).
pub fn sphere(edge: f64) -> Sphere {
    let scale = edge / Setup::default().edge;
    let coupling = Some((500.0 * scale.powi(2), 5.0 * scale.powf(2.5)));
    Sphere { mass: 0.05 * scale.powi(3), coupling, speed: 0.0, path: Vec::new() }
}

/// A sphere of mass `mass` (kg) without a coupling is thrown at the block, without gravity. The case lasts so long that
/// the sphere can go through the block and the block can come to rest.
pub fn throw(setup: Setup, mass: f64) -> Case {
    let sphere = Sphere { mass, coupling: None, speed: THROWN, path: Vec::new() };
    let setup = Setup { attachment: Attachment::Bottom, gravity: 0.0, ..setup };
    let block = setup.material.density * setup.edge.powi(3);
    let is_brief = mass <= BOUNCES * block || mass >= PASSES * block;
    let through = ((1.5 + 2.0 * RADIUS) * setup.edge / THROWN / setup.dt).ceil() as usize;
    let steps = through + damped_steps(&setup);
    let promise = Promise { parts: is_brief, ..left_alone(&setup) };
    let settling = Some(Settling { steps: None, other: 0.0 });
    let setup = Setup { sphere: Some(sphere), ..setup };
    Case { scenario: "throw", setup, start: Start::Rest, steps, promise, settling }
}

/// The block, attached at its bottom, is stretched, compressed or turned inside out by `factor`, and released.
pub fn release(setup: Setup, factor: f64) -> Case {
    let setup = Setup { attachment: Attachment::Bottom, ..setup };
    let steps = damped_steps(&setup);
    let promise = Promise { shape: Some(SHAPE * setup.edge), ..Promise::default() };
    let settling = Some(Settling { steps: Some(steps), other: 0.0 });
    let scenario = match setup.material.law {
        MaterialLaw::Corotational => "release",
        MaterialLaw::NeoHookean => "release, neo-Hookean",
    };
    Case { scenario, setup, start: Start::Stretched(factor), steps, promise, settling }
}

/// The sphere of [`sphere`], on a coupling so stiff that the sphere closely follows the haptic device.
fn pushed(edge: f64) -> Sphere {
    let tool = sphere(edge);
    Sphere { coupling: tool.coupling.map(|(stiffness, damping)| (100.0 * stiffness, 10.0 * damping)), ..tool }
}

/// The haptic device goes down through the block at `speed` (m/s), and stays below it.
pub fn thrust(setup: Setup, speed: f64) -> Case {
    let gap = 0.02 * setup.edge;
    let way = (1.5 + 2.0 * RADIUS) * setup.edge;
    let after = damped_steps(&setup);
    let steps = (way / speed / setup.dt).ceil() as usize + after;
    let path = vec![(0.0, gap), (way / speed, gap - way)];
    let tool = Sphere { path, ..pushed(setup.edge) };
    let settling = Some(Settling { steps: Some(after), other: swing(&tool, setup.dt) });
    let promise = left_alone(&setup);
    let setup = Setup { attachment: Attachment::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "thrust", setup, start: Start::Rest, steps, promise, settling }
}

/// Between two steps the haptic device jumps into the block, to `way` (m) below the top of the block as it sags under
/// its weight; later the device jumps back to above the block.
pub fn teleport(setup: Setup, way: f64) -> Case {
    let gap = 0.02 * setup.edge;
    let [at, back] = [1.0, 5.0].map(|times| times * TELEPORTED * setup.dt);
    let (deep, away) = (-way - sag(&setup), AWAY * setup.edge);
    let path = vec![(0.0, gap), (at, gap), (at + 1e-9, deep), (back, deep), (back + 1e-9, away)];
    let after = damped_steps(&setup);
    let steps = (5.0 * TELEPORTED).ceil() as usize + after;
    let tool = Sphere { path, ..pushed(setup.edge) };
    let settling = Some(Settling { steps: Some(after), other: swing(&tool, setup.dt) });
    let promise = left_alone(&setup);
    let setup = Setup { attachment: Attachment::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "teleport", setup, start: Start::Rest, steps, promise, settling }
}

/// A free block spins at the angular speed `speed` (rad/s) without gravity: its centre must stay in place.
pub fn spin(setup: Setup, speed: f64) -> Case {
    let promise = Promise { drift: Some((0, DRIFT * setup.edge)), ..Promise::default() };
    let setup = Setup { attachment: Attachment::Nothing, gravity: 0.0, ..setup };
    Case { scenario: "spin", setup, start: Start::Spinning(speed), steps: 200, promise, settling: None }
}

/// A block rests on a floor for `steps` steps: once settled, it must stay in place.
pub fn rest(setup: Setup, steps: usize) -> Case {
    let setup = Setup { attachment: Attachment::Nothing, has_floor: true, ..setup };
    let drift = Some((SETTLED, DRIFT * setup.edge));
    let promise = Promise { rest: Some(AT_REST), drift, touches: true, ..Promise::default() };
    Case { scenario: "rest", setup, start: Start::Rest, steps, promise, settling: None }
}

/// A bar with a heavy end hangs from a fixed end: once it is at rest, the forces on each node are balanced, so that it
/// hangs straight down.
pub fn hang_loaded(setup: Setup) -> Case {
    let setup = Setup { attachment: Attachment::Bottom, ..setup };
    let promise = Promise { rest: Some(AT_REST), balanced: true, ..Promise::default() };
    Case { scenario: "hang, loaded", setup, start: Start::Rest, steps: 600, promise, settling: None }
}

/// The given case with the promise that the block's centre stays in place, for a block that nothing can move, since it
/// has no weight or all its nodes are attached.
pub fn still(case: Case) -> Case {
    let promise = Promise { drift: Some((0, STILL * case.setup.edge)), ..case.promise };
    Case { promise, ..case }
}

/// Two cases: a block that is released, and one that is pressed. Both blocks are damped so that they come to rest.
pub fn both(setup: Setup) -> Vec<Case> {
    let edge = setup.edge;
    vec![hang(setup.clone().damped()), press(setup.damped(), sphere(edge))]
}

/// Three cases: a damped block that is released and comes to rest, and two blocks without damping, one pressed and one
/// plucked (stretched and released), since damping might hide errors of the step.
pub fn bare(setup: Setup) -> Vec<Case> {
    let edge = setup.edge;
    vec![hang(setup.clone().damped()), press(setup.clone(), sphere(edge)), pluck(setup)]
}
