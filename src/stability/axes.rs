//! The matrix: what is varied, along which values, and what each case promises.

use super::laws::Promise;
use super::setup::{Bound, Setup, Sphere};
use crate::scene::Law;

/// Steps of a case at most, and at least.
const STEPS: [f64; 2] = [40.0, 400.0];
/// Damping times time after which what swung is at rest, ln(1e-6).
const TO_REST: f64 = 14.0;
/// s: how long the sphere is pressed in, held, drawn out, and left to itself.
const PRESS: f64 = 0.24;
/// When each of these ends, of the whole.
const PHASES: [f64; 3] = [0.25, 0.5, 0.65];
/// How deep the device goes, and how far it goes up at the end, of the block's edge.
const DEPTH: f64 = 0.1;
const AWAY: f64 = 0.2;

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
}

/// A value of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// With its unit.
    pub label: String,
    /// Whether it is of the region where all must pass.
    pub is_core: bool,
    /// Its simulations.
    pub cases: Vec<Case>,
}

/// What is varied.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// As `--only` calls it.
    pub name: &'static str,
    /// For readers.
    pub title: &'static str,
    /// Its values, rising.
    pub cells: Vec<Cell>,
}

/// Names of all axes, in order.
pub const NAMES: [&str; 4] = ["young", "poisson", "poisson-neo-hookean", "density"];

/// Let go under gravity.
pub fn hang(setup: Setup) -> Case {
    let setup = Setup { bound: Bound::Side, ..setup };
    let (steps, left) = damped_steps(&setup);
    Case {
        scenario: "hang",
        setup,
        start: Start::Rest,
        steps,
        promise: Promise { rest: Some(left), ..Promise::default() },
    }
}

/// How many steps it takes to come to rest, or as many as are done, and what is left of its motion then.
fn damped_steps(setup: &Setup) -> (usize, f64) {
    let rate = setup.material.damping_mass;
    let steps = (TO_REST / rate / setup.dt).ceil().clamp(STEPS[0], STEPS[1]);
    (steps as usize, left(rate * setup.dt, steps))
}

/// Of the energy of motion after so many steps, at most: implicit damping by mass, and ten times that, since what swings
/// at first has not only one mode.
fn left(damping: f64, steps: f64) -> f64 {
    (10.0 * (1.0 + damping).powf(-steps)).min(1.0)
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
    // The tool's own swing on its coupling; where it only creeps, by the slower of its two rates.
    let critical = 2.0 * (stiffness * sphere.mass).sqrt();
    let own = if damping < critical { damping / sphere.mass } else { stiffness / damping };
    let rate = setup.material.damping_mass.min(own);
    let after = (1.0 - PHASES[2]) * steps;
    let promise = Promise { rest: Some(left(rate * setup.dt, after)), ..Promise::default() };
    let setup = Setup { bound: Bound::Bottom, sphere: Some(Sphere { path, ..sphere }), ..setup };
    Case { scenario: "press", setup, start: Start::Rest, steps: steps as usize, promise }
}

/// A sphere of 50 g on a coupling of 500 N/m, scaled with the block.
pub fn sphere(edge: f64) -> Sphere {
    let scale = edge / Setup::default().edge;
    let coupling = Some((500.0 * scale.powi(2), 5.0 * scale.powf(2.5)));
    Sphere { mass: 0.05 * scale.powi(3), coupling, speed: 0.0, path: Vec::new() }
}

/// Both scenarios of a setup.
fn both(setup: Setup) -> Vec<Case> {
    let edge = setup.edge;
    vec![hang(setup.clone().damped()), press(setup.damped(), sphere(edge))]
}

fn with(change: impl Fn(&mut Setup)) -> Setup {
    let mut setup = Setup::default();
    change(&mut setup);
    setup
}

/// The axis of a name.
pub fn axis(name: &str, is_quick: bool) -> Option<Axis> {
    let pick = |full: &[f64], quick: &[f64]| if is_quick { quick.to_vec() } else { full.to_vec() };
    let of = |name, title, values: Vec<f64>, label: &dyn Fn(f64) -> String, core: std::ops::RangeInclusive<f64>, cases: &dyn Fn(f64) -> Vec<Case>| {
        let cell = |value: f64| Cell { label: label(value), is_core: core.contains(&value), cases: cases(value) };
        Axis { name, title, cells: values.into_iter().map(cell).collect() }
    };
    let poisson = |law: Law| move |nu: f64| both(with(|s| (s.material.poisson, s.material.law) = (nu, law)));
    let ratios = pick(&[-0.5, -0.25, 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999], &[-0.5, 0.0, 0.45, 0.4999]);
    Some(match name {
        "young" => of(
            "young",
            "Young's modulus",
            pick(&[1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12], &[1.0, 1e3, 1e7, 1e12]),
            &|x| si(x, "Pa"),
            1e3..=1e7,
            &|young| both(with(|s| s.material.young = young)),
        ),
        "poisson" => of("poisson", "Poisson's ratio, corotational", ratios, &|x| format!("{x}"), 0.0..=0.49, &poisson(Law::Corotational)),
        "poisson-neo-hookean" => {
            of("poisson-neo-hookean", "Poisson's ratio, neo-Hookean", ratios, &|x| format!("{x}"), 0.0..=0.49, &poisson(Law::NeoHookean))
        }
        "density" => of(
            "density",
            "Density",
            pick(&[1.0, 10.0, 100.0, 1000.0, 5000.0, 20000.0], &[1.0, 1000.0, 20000.0]),
            &|x| format!("{x} kg/m^3"),
            100.0..=5000.0,
            &|density| both(with(|s| s.material.density = density)),
        ),
        _ => return None,
    })
}

/// A number with its unit and thousands' prefix.
pub fn si(value: f64, unit: &str) -> String {
    let (scale, prefix) = match value.abs() {
        x if x >= 1e12 => (1e-12, "T"),
        x if x >= 1e9 => (1e-9, "G"),
        x if x >= 1e6 => (1e-6, "M"),
        x if x >= 1e3 => (1e-3, "k"),
        x if x >= 1.0 || x == 0.0 => (1.0, ""),
        x if x >= 1e-3 => (1e3, "m"),
        _ => (1e6, "u"),
    };
    let digits = (value * scale * 1e3).round() / 1e3;
    format!("{digits} {prefix}{unit}")
}
