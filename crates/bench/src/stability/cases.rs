//! Cases of the matrix: how a block is let go, pressed, thrown at and torn, and what each case promises.

use palpate::scene::Law;

use super::laws::{AT_REST, DRIFT, Promise};
use super::modes;
use super::setup::{Bound, RADIUS, Setup, Sphere};
use super::trace::HALF_ULP;

/// Steps of a case at least, and at most until it is at rest.
const STEPS: [f64; 2] = [40.0, 2500.0];
/// Steps of pressing at most, of what is not at rest in time, and those after pressing.
const PRESS_STEPS: f64 = 400.0;
const AFTER_STEPS: f64 = 1000.0;
/// Steps where nothing damps.
const UNDAMPED: f64 = 200.0;
/// Where a block is let go that nothing damps it is stretched by a tenth; a stiffer one than the usual by less, so that it has
/// no more energy.
const PLUCKED: f64 = 0.1;
/// Damping times time after which what swung is at rest, ln(1e-6).
const TO_REST: f64 = 14.0;
/// s: how long the sphere is pressed in, held, drawn out, and left to itself.
const PRESS: f64 = 0.24;
/// When each of these ends, of the whole.
const PHASES: [f64; 3] = [0.25, 0.5, 0.65];
/// How deep the device goes, and how far it goes up at the end, of the block's edge.
const DEPTH: f64 = 0.1;
const AWAY: f64 = 0.2;

/// A block dropped on the floor has settled after so many steps.
const SETTLED: usize = 500;
/// What nothing moves is where it was, of the block's edge.
const STILL: f64 = 1e-9;
/// What was let go is within this of its shape, of its edge. A block of the usual stiffness sags by a fortieth under its weight;
/// of what sags by more than a half of this nothing is promised.
const SHAPE: f64 = 0.1;
/// A thrown sphere that weighs less than the first of the block's mass bounces off; of more than the second, it goes through.
const BOUNCES: f64 = 0.2;
const PASSES: f64 = 500.0;
/// Sums within a body round their largest part some times over.
const INSIDE: f64 = 4.0;
/// The sphere that is thrown, m/s.
const THROWN: f64 = 0.5;
/// Steps before the device is elsewhere, and as many until it is back.
const TELEPORTED: f64 = 20.5;

/// How the body begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// At rest.
    Rest,
    /// Stretched along y from the plane y = 0, by this factor (below zero: inside out).
    Stretched(f64),
    /// Turning about its middle, rad/s, about an axis that is none of its own.
    Spinning(f64),
}

/// One simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Which of its cell.
    pub scenario: &'static str,
    /// The scene.
    pub setup: Setup,
    /// How it begins.
    pub start: Start,
    /// How many.
    pub steps: usize,
    /// What it promises.
    pub promise: Promise,
    /// What it has to come to rest; `None`: nothing is promised of that, or `promise` says it.
    pub settling: Option<Settling>,
}

/// What is left to come to rest in, and the slowest decay of what is not the body, of its velocity, a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settling {
    /// Steps at least; `None`: those after the last in which anything pressed.
    pub steps: Option<usize>,
    /// Of the tool; 0: there is none.
    pub other: f64,
}

/// Let go under gravity.
pub fn hang(setup: Setup) -> Case {
    let setup = Setup { bound: Bound::Side, ..setup };
    let steps = damped_steps(&setup);
    let scenario = if setup.material.damping_mass > 0.0 { "hang" } else { "hang, undamped" };
    let settling = Some(Settling { steps: Some(steps), other: 0.0 });
    Case { scenario, setup, start: Start::Rest, steps, promise: Promise::default(), settling }
}

/// How many steps it takes to come to rest; where those are too many, or nothing damps, some.
fn damped_steps(setup: &Setup) -> usize {
    let rate = setup.material.damping_mass;
    let steps = if rate > 0.0 { (TO_REST / rate / setup.dt).ceil() } else { UNDAMPED };
    // What takes longer than is done is not at rest either way.
    if steps > STEPS[1] { PRESS_STEPS as usize } else { steps.max(STEPS[0]) as usize }
}

/// Let go where nothing holds, weighs or damps it: its middle stays, and it may swing no wider.
pub fn pluck(setup: Setup) -> Case {
    let usual = Setup::default();
    let stiffer = setup.material.young / usual.material.young * usual.edge / setup.edge;
    let stretch = PLUCKED * stiffer.max(1.0).sqrt().recip();
    // No node is faster than the stretch a step; of that the solver leaves a share, with which the middle goes on.
    let way = stretch * UNDAMPED;
    let solved = DRIFT * (1.0 + way);
    // And what a step turns over of momentum inside, in waves' ways a step squared, is rounded.
    let waves = setup.material.young / setup.material.density * (setup.dt / setup.edge).powi(2);
    let rounded = INSIDE * HALF_ULP * waves * way;
    let promise = Promise { drift: Some((0, (solved + rounded) * setup.edge)), ..Promise::default() };
    let setup = Setup { bound: Bound::Nothing, gravity: 0.0, ..setup };
    let (start, steps) = (Start::Stretched(1.0 + stretch), UNDAMPED as usize);
    Case { scenario: "pluck", setup, start, steps, promise, settling: None }
}

/// How far the top of a block sinks under its own weight, m.
fn sag(setup: &Setup) -> f64 {
    0.5 * setup.material.density * setup.gravity * setup.edge.powi(2) / setup.material.young
}

/// Of the end of a case in which a tool touched a block: it is out again, and the block is as it was.
fn left_alone(setup: &Setup) -> Promise {
    let is_firm = sag(setup) <= 0.5 * SHAPE * setup.edge;
    Promise { shape: is_firm.then_some(SHAPE * setup.edge), touches: true, parts: is_firm, ..Promise::default() }
}

/// Pressed in by a held sphere, and released.
pub fn press(setup: Setup, sphere: Sphere) -> Case {
    let pressing = (PRESS / setup.dt).round().clamp(STEPS[0], PRESS_STEPS);
    let end = pressing * setup.dt;
    let [down, held, up] = PHASES.map(|phase| phase * end);
    let after = ((1.0 - PHASES[2]) * pressing).max(damped_steps(&setup) as f64).min(AFTER_STEPS);
    let steps = (PHASES[2] * pressing + after).ceil() as usize;
    let gap = 0.02 * setup.edge;
    // Where more than the usual weight has taken the top.
    let usual = Setup { gravity: Setup::default().gravity, ..setup.clone() };
    let sunk = (sag(&setup) - sag(&usual)).clamp(0.0, 0.5 * setup.edge);
    let deep = -DEPTH * setup.edge - sunk;
    let path = vec![(0.0, gap), (down, deep), (held, deep), (up, AWAY * setup.edge)];
    let settling = Some(Settling { steps: Some(after as usize), other: swing(&sphere, setup.dt) });
    let scenario = if setup.material.damping_mass > 0.0 { "press" } else { "press, undamped" };
    let promise = left_alone(&setup);
    let setup = Setup { bound: Bound::Bottom, sphere: Some(Sphere { path, ..sphere }), ..setup };
    Case { scenario, setup, start: Start::Rest, steps, promise, settling }
}

/// What a step leaves of a sphere's own swing on its coupling.
fn swing(sphere: &Sphere, dt: f64) -> f64 {
    let (stiffness, damping) = sphere.coupling.unwrap_or((0.0, 0.0));
    modes::decay((stiffness / sphere.mass).sqrt(), damping / sphere.mass, dt)
}

/// A sphere of 50 g on a coupling of 500 N/m, scaled with the block.
pub fn sphere(edge: f64) -> Sphere {
    let scale = edge / Setup::default().edge;
    let coupling = Some((500.0 * scale.powi(2), 5.0 * scale.powf(2.5)));
    Sphere { mass: 0.05 * scale.powi(3), coupling, speed: 0.0, path: Vec::new() }
}

/// A free sphere that flies at the block, nothing weighs: for as long as it takes it to go through, and the block to come to
/// rest then.
pub fn throw(setup: Setup, mass: f64) -> Case {
    let sphere = Sphere { mass, coupling: None, speed: THROWN, path: Vec::new() };
    let setup = Setup { bound: Bound::Bottom, gravity: 0.0, ..setup };
    let block = setup.material.density * setup.edge.powi(3);
    let is_brief = mass <= BOUNCES * block || mass >= PASSES * block;
    let through = ((1.5 + 2.0 * RADIUS) * setup.edge / THROWN / setup.dt).ceil() as usize;
    let steps = through + damped_steps(&setup);
    let promise = Promise { parts: is_brief, ..left_alone(&setup) };
    let settling = Some(Settling { steps: None, other: 0.0 });
    let setup = Setup { sphere: Some(sphere), ..setup };
    Case { scenario: "throw", setup, start: Start::Rest, steps, promise, settling }
}

/// Stretched, pressed or turned inside out, and let go.
pub fn release(setup: Setup, factor: f64) -> Case {
    let setup = Setup { bound: Bound::Bottom, ..setup };
    let steps = damped_steps(&setup);
    let promise = Promise { shape: Some(SHAPE * setup.edge), ..Promise::default() };
    let settling = Some(Settling { steps: Some(steps), other: 0.0 });
    let scenario = match setup.material.law {
        Law::Corotational => "release",
        Law::NeoHookean => "release, neo-Hookean",
    };
    Case { scenario, setup, start: Start::Stretched(factor), steps, promise, settling }
}

/// As [`sphere`], on a coupling so stiff that it goes where the device goes.
fn pushed(edge: f64) -> Sphere {
    let tool = sphere(edge);
    Sphere { coupling: tool.coupling.map(|(stiffness, damping)| (100.0 * stiffness, 10.0 * damping)), ..tool }
}

/// The device goes down through block and all at a speed, m/s, and stays below.
pub fn thrust(setup: Setup, speed: f64) -> Case {
    let gap = 0.02 * setup.edge;
    let way = (1.5 + 2.0 * RADIUS) * setup.edge;
    let after = damped_steps(&setup);
    let steps = (way / speed / setup.dt).ceil() as usize + after;
    let path = vec![(0.0, gap), (way / speed, gap - way)];
    let tool = Sphere { path, ..pushed(setup.edge) };
    let settling = Some(Settling { steps: Some(after), other: swing(&tool, setup.dt) });
    let promise = left_alone(&setup);
    let setup = Setup { bound: Bound::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "thrust", setup, start: Start::Rest, steps, promise, settling }
}

/// The device is elsewhere from one step to the next, into the block by so many metres, and later back above it. Reckoned from
/// where the block's top is once it has sagged.
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
    let setup = Setup { bound: Bound::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "teleport", setup, start: Start::Rest, steps, promise, settling }
}

/// A free block that turns, nothing weighs: its middle stays.
pub fn spin(setup: Setup, speed: f64) -> Case {
    let promise = Promise { drift: Some((0, DRIFT * setup.edge)), ..Promise::default() };
    let setup = Setup { bound: Bound::Nothing, gravity: 0.0, ..setup };
    Case { scenario: "spin", setup, start: Start::Spinning(speed), steps: 200, promise, settling: None }
}

/// On a floor for so many steps: once settled, it stays.
pub fn rest(setup: Setup, steps: usize) -> Case {
    let setup = Setup { bound: Bound::Nothing, has_floor: true, ..setup };
    let drift = Some((SETTLED, DRIFT * setup.edge));
    let promise = Promise { rest: Some(AT_REST), drift, touches: true, ..Promise::default() };
    Case { scenario: "rest", setup, start: Start::Rest, steps, promise, settling: None }
}

/// The same without weight: nothing moves at all.
pub fn still(case: Case) -> Case {
    let promise = Promise { drift: Some((0, STILL * case.setup.edge)), ..case.promise };
    Case { promise, ..case }
}

/// Let go, and pressed, damped so that they come to rest.
pub fn both(setup: Setup) -> Vec<Case> {
    let edge = setup.edge;
    vec![hang(setup.clone().damped()), press(setup.damped(), sphere(edge))]
}

/// Let go damped, so that it comes to rest; pressed and plucked with nothing to damp it, so that no damping hides what the
/// step does.
pub fn bare(setup: Setup) -> Vec<Case> {
    let edge = setup.edge;
    vec![hang(setup.clone().damped()), press(setup.clone(), sphere(edge)), pluck(setup)]
}
