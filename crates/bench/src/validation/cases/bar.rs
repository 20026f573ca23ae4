//! Bars in one dimension, with Poisson's ratio zero: hanging under their weight, and hitting a rigid floor.

use glam::DVec3;
use palpate::Result;

use super::super::lab::{Lab, Run};
use super::super::series::{Convergence, Function, Model, Quantity};
use super::{Case, face, head, support};

const YOUNG: f64 = 2e4;
const DENSITY: f64 = 1000.0;
/// Length and width of the bars, m.
const LENGTH: f64 = 0.2;
const WIDTH: f64 = 0.02;
/// Cells across the bar.
const CELLS: [u32; 3] = [2, 4, 6];
const GRAVITY: f64 = 9.81;
/// Share of the force below which contact has ended. Implicit Euler blurs the wave that ends it; the floor doubles that
/// wave, so that the force has fallen to nothing when the middle of the wave arrives.
const LEAST: f64 = 0.02;
/// Speed at which the bar hits the floor, m/s.
const SPEED: f64 = 0.1;
/// Contact stiffness with one cell across, N/m^3. It grows with the square of the number of cells.
const STIFFNESS: f64 = 2e7;

/// A bar under its own weight.
pub const HANGING: Case = Case {
    name: "hanging",
    title: "Bar that hangs under its weight",
    source: "S. P. Timoshenko and J. N. Goodier, \"Theory of elasticity\" (1951), stretching of a prismatical bar by \
             its own weight: rho g l^2 / (2 E)",
    problem: "A bar of 20 cm and 2 x 2 cm section, 20 kPa, 1,000 kg/m^3, hangs from a plane of rollers; the \
              elongation is a twentieth of its length. With Poisson's ratio zero the corotational law is linear \
              here, and the formula exact.",
    measure: hanging,
};

/// A bar that hits a floor.
pub const IMPACT: Case = Case {
    name: "impact",
    title: "Bar that hits a rigid floor",
    source: "S. P. Timoshenko and J. N. Goodier, \"Theory of elasticity\" (1951), longitudinal impact of bars (after \
             Saint-Venant 1883): the force is A v sqrt(E rho) for the time 2 l sqrt(rho / E)",
    problem: "The bar, without weight, falls on its end at 0.1 m/s, 1/45 of its speed of sound. The force is \
              that which changes the bar's momentum, its mean over the middle half of the time in contact by the \
              formula; the bar touches the floor at the start, and the time in contact ends where 2 % of the force is \
              left. Steps and contact's penalty are refined with the cells.",
    measure: impact,
};

fn bar(dt: f64, gravity: f64, cells: u32, more: &str) -> String {
    let along = (LENGTH / WIDTH) as u32 * cells;
    head(dt, [0.0, -gravity, 0.0], 1e-6)
        + &format!(
            "[[body]]\nname = \"bar\"\nlayer = {{ box = [[0.0, 0.0, 0.0], [{WIDTH:?}, {LENGTH:?}, {WIDTH:?}]], \
             cells = [{cells}, {along}, {cells}] }}\n{more}"
        )
}

fn material(damping: f64) -> String {
    format!("material = {{ young = {YOUNG:?}, poisson = 0.0, density = {DENSITY:?}, damping_mass = {damping:?} }}\n")
}

fn hanging(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let more = material(20.0) + &support("top", "plane = [0, 1, 0]", &face(1, LENGTH)) + &guides();
        let mut run = lab.open(&format!("{cells} cells across"), &bar(0.02, GRAVITY, cells, &more))?;
        run.rest(50, 1000)?;
        let low = run.displacement(DVec3::new(0.5 * WIDTH, 0.0, 0.5 * WIDTH))?;
        levels.push(run.level(1.0 / f64::from(cells), -low.y));
    }
    let published = DENSITY * GRAVITY * LENGTH.powi(2) / (2.0 * YOUNG);
    Ok(vec![Quantity::new("elongation", "m", published, Convergence::Order(2.0, Function::Value), levels)])
}

/// Planes of symmetry on two sides, which keep the bar from swinging.
fn guides() -> String {
    support("left", "plane = [1, 0, 0]", &face(0, 0.0)) + &support("back", "plane = [0, 0, 1]", &face(2, 0.0))
}

fn impact(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let sound = (YOUNG / DENSITY).sqrt();
    let force = WIDTH * WIDTH * SPEED * (YOUNG * DENSITY).sqrt();
    let time = 2.0 * LENGTH / sound;
    let (mut forces, mut times) = (Vec::new(), Vec::new());
    for &cells in lab.levels(&CELLS) {
        let dt = 0.25 * WIDTH / f64::from(cells) / sound;
        let more = format!("velocity = [0.0, {:?}, 0.0]\n", -SPEED)
            + &material(0.0)
            + &format!(
                "[[body]]\nname = \"floor\"\nplane = [0, 1, 0, 0]\n[contact]\nstiffness = {:?}\n",
                STIFFNESS * f64::from(cells * cells)
            );
        let label = format!("{cells} cells across");
        let mut run = lab.open(&label, &bar(dt, 0.0, cells, &more))?;
        let samples = pushes(&mut run, dt, 1.5 * time)?;
        let middle: Vec<f64> =
            samples.iter().filter(|(t, _)| (0.25..0.75).contains(&(t / time))).map(|(_, push)| *push).collect();
        let mean = middle.iter().sum::<f64>() / middle.len() as f64;
        forces.push(run.level(1.0 / f64::from(cells), mean));
        times.push(run.level(1.0 / f64::from(cells), end_of_contact(&samples, LEAST * force)));
    }
    let first = Convergence::Order(1.0, Function::Value);
    let model = Model { uncertainty: 2e-3, reason: "the time ends where 2 % of the force is left", ..Model::default() };
    Ok(vec![
        Quantity::new("force", "N", force, first, forces),
        Quantity { model, ..Quantity::new("time in contact", "s", time, first, times) },
    ])
}

/// The time, s, at which the force falls below `least` for good; NaN if it never does.
fn end_of_contact(samples: &[(f64, f64)], least: f64) -> f64 {
    let last = samples.windows(2).rfind(|pair| pair[0].1 >= least && pair[1].1 < least);
    last.map_or(f64::NAN, |pair| {
        let ((before, high), (after, low)) = (pair[0], pair[1]);
        before + (after - before) * (high - least) / (high - low)
    })
}

/// Times (s) at the middle of steps, and the upward force on the bar in them (N), from its momentum.
fn pushes(run: &mut Run, dt: f64, until: f64) -> Result<Vec<(f64, f64)>> {
    let mut before = run.momentum()?;
    let mut samples = Vec::new();
    for step in 0..(until / dt).ceil() as usize {
        run.step()?;
        let after = run.momentum()?;
        samples.push(((step as f64 + 0.5) * dt, (after.y - before.y) / dt));
        before = after;
    }
    Ok(samples)
}
