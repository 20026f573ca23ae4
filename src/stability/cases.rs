//! Cases of the matrix: how a block is let go, pressed, thrown at and torn, and what each case promises.

use super::laws::{AT_REST, DRIFT, Promise};
use super::modes;
use super::setup::{Bound, RADIUS, Setup, Sphere};
use crate::scene::Law;

/// Steps of a case at most, and at least.
const STEPS: [f64; 2] = [40.0, 400.0];
/// Steps where nothing damps.
const UNDAMPED: f64 = 200.0;
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

/// Steps that are left to come to rest in, and the slowest decay of what is not the body, of its velocity, a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settling {
    /// Steps.
    pub steps: usize,
    /// Of the tool; 0: there is none.
    pub other: f64,
}

/// Let go under gravity.
pub fn hang(setup: Setup) -> Case {
    let setup = Setup { bound: Bound::Side, ..setup };
    let steps = damped_steps(&setup);
    let settling = Some(Settling { steps, other: 0.0 });
    Case { scenario: "hang", setup, start: Start::Rest, steps, promise: Promise::default(), settling }
}

/// How many steps it takes to come to rest, or as many as are done.
fn damped_steps(setup: &Setup) -> usize {
    let rate = setup.material.damping_mass;
    let steps = if rate > 0.0 { (TO_REST / rate / setup.dt).ceil() } else { UNDAMPED };
    steps.clamp(STEPS[0], STEPS[1]) as usize
}

/// Pressed in by a held sphere, and released.
pub fn press(setup: Setup, sphere: Sphere) -> Case {
    let steps = (PRESS / setup.dt).round().clamp(STEPS[0], STEPS[1]);
    let end = steps * setup.dt;
    let [down, held, up] = PHASES.map(|phase| phase * end);
    let gap = 0.02 * setup.edge;
    let deep = -DEPTH * setup.edge;
    let path = vec![(0.0, gap), (down, deep), (held, deep), (up, AWAY * setup.edge)];
    let (stiffness, damping) = sphere.coupling.unwrap_or((0.0, 0.0));
    // The tool's own swing on its coupling.
    let other = modes::decay((stiffness / sphere.mass).sqrt(), damping / sphere.mass, setup.dt);
    let settling = Some(Settling { steps: ((1.0 - PHASES[2]) * steps) as usize, other });
    let setup = Setup { bound: Bound::Bottom, sphere: Some(Sphere { path, ..sphere }), ..setup };
    Case { scenario: "press", setup, start: Start::Rest, steps: steps as usize, promise: Promise::default(), settling }
}

/// A sphere of 50 g on a coupling of 500 N/m, scaled with the block.
pub fn sphere(edge: f64) -> Sphere {
    let scale = edge / Setup::default().edge;
    let coupling = Some((500.0 * scale.powi(2), 5.0 * scale.powf(2.5)));
    Sphere { mass: 0.05 * scale.powi(3), coupling, speed: 0.0, path: Vec::new() }
}

/// A free sphere that flies at the block, nothing weighs.
pub fn throw(setup: Setup, mass: f64) -> Case {
    let sphere = Sphere { mass, coupling: None, speed: 0.5, path: Vec::new() };
    let setup = Setup { bound: Bound::Bottom, gravity: 0.0, sphere: Some(sphere), ..setup };
    Case { scenario: "throw", setup, start: Start::Rest, steps: 200, promise: Promise::default(), settling: None }
}

/// Stretched, pressed or turned inside out, and let go.
pub fn release(setup: Setup, factor: f64) -> Case {
    let setup = Setup { bound: Bound::Bottom, ..setup };
    let steps = damped_steps(&setup);
    // At rest a block of the usual stiffness sags by a fortieth of its edge.
    let promise = Promise { shape: Some(0.1 * setup.edge), ..Promise::default() };
    let settling = Some(Settling { steps, other: 0.0 });
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

/// The device goes down through block and all at a speed, m/s.
pub fn thrust(setup: Setup, speed: f64) -> Case {
    let gap = 0.02 * setup.edge;
    let way = (1.5 + 2.0 * RADIUS) * setup.edge;
    let steps = (way / speed / setup.dt).ceil() as usize + 100;
    let path = vec![(0.0, gap), (way / speed, gap - way)];
    let tool = Sphere { path, ..pushed(setup.edge) };
    let setup = Setup { bound: Bound::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "thrust", setup, start: Start::Rest, steps, promise: Promise::default(), settling: None }
}

/// The device is elsewhere from one step to the next, down by so many metres.
pub fn teleport(setup: Setup, way: f64) -> Case {
    let gap = 0.02 * setup.edge;
    let at = 20.5 * setup.dt;
    let path = vec![(0.0, gap), (at, gap), (at + 1e-9, gap - way)];
    let tool = Sphere { path, ..pushed(setup.edge) };
    let setup = Setup { bound: Bound::Bottom, sphere: Some(tool), ..setup };
    Case { scenario: "teleport", setup, start: Start::Rest, steps: 220, promise: Promise::default(), settling: None }
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
    let promise = Promise { rest: Some(AT_REST), drift: Some((SETTLED, DRIFT * setup.edge)), ..Promise::default() };
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
