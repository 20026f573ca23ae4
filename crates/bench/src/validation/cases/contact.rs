//! Contact and friction: a ball pressed into a layer, and a block on a slope.

use glam::DVec3;
use palpate::scene::{Layer, Samples};
use palpate::{Error, Result};

use super::super::lab::{Lab, Run};
use super::super::series::{Convergence, Function, Model, Quantity};
use super::{Case, head};
use crate::accuracy::space::press::{Body, HEIGHT, Press, STEPS};
use crate::accuracy::space::shapes::{ball, graded_block};
use crate::accuracy::space::stiffness::hertz;

/// Cells across the block.
const CELLS: [u32; 3] = [12, 18, 27];
/// Half the width of the block, m.
const HALF_WIDTH: f64 = 0.1;
/// Cells are finer by the factor 1 + this under the ball.
const GRADES: DVec3 = DVec3::new(3.0, 1.0, 3.0);
/// Triangle edges along a quarter of the ball's girth; at its pole they are finer by the factor 1 + the second number.
const BALL: (u32, f64) = (64, 8.0);
const RADIUS: f64 = 0.4;
const DEPTH: f64 = 0.0005;
const POISSON: f64 = 0.3;
/// Contact stiffness with one cell across, N/m^3; it grows with the square of the number of cells.
const STIFFNESS: f64 = 1e6;
/// Force by the integral equation of frictionless contact with a bonded layer, over that of the series.
const EXCESS: f64 = 1.0218;

/// A rigid ball on a bonded layer.
pub const INDENTATION: Case = Case {
    name: "indentation",
    title: "Rigid ball pressed into a bonded layer",
    source: "E. K. Dimitriadis and others, \"Determination of elastic moduli of thin layers of soft material using \
             the atomic force microscope\" (2002), equation 13, a series on the law of H. Hertz (1882)",
    problem: "A ball of 40 cm radius is pressed 0.5 mm into a block of 20 x 4 x 20 cm whose bottom is bonded to a \
              rigid base (20 kPa, Poisson's ratio 0.3), with cells four times as fine as even ones under the ball. \
              Contact's penalty is refined with the cells. The force is that on the ball.",
    measure: indentation,
};

fn indentation(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let ball = lab.folder.surface("ball", &ball(RADIUS, BALL.0, BALL.1))?;
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let size = DVec3::new(HALF_WIDTH, HEIGHT, HALF_WIDTH);
        let counts = [cells, cells.div_ceil(2), cells];
        let layer = Layer::File(graded_block(&lab.folder, &format!("block{cells}"), size, counts, GRADES)?);
        let press = Press {
            poisson: POISSON,
            depth: DEPTH,
            radius: RADIUS,
            ball: Some(ball.clone()),
            stiffness: Some(STIFFNESS * f64::from(cells * cells)),
            ..Press::new(Body::Based(None, layer))
        };
        let mut scene = press.scene();
        scene.contact.samples = Samples::Triangles;
        let mut run = lab.open_scene(&format!("{cells} cells across"), &scene)?;
        let mut force = f64::NAN;
        for _ in 0..STEPS {
            force = run.step()?.tool.map_or(f64::NAN, |tool| tool.force.y);
        }
        levels.push(run.level(1.0 / f64::from(cells), force));
    }
    let model = Model {
        offset: EXCESS - 1.0,
        uncertainty: 1e-2,
        reason: "the series is 2.2 % low at this depth, by the integral equation that it approximates; and the layer \
                 has no sides there",
    };
    let published = hertz(RADIUS, DEPTH, POISSON);
    let convergence = Convergence::Order(2.0, Function::Value);
    Ok(vec![Quantity { model, ..Quantity::new("force", "N", published, convergence, levels) }])
}

/// Mass of the block of PyElastica's case, kg.
const MASS: f64 = 1.0;
/// Coefficient of friction.
const FRICTION: f64 = 0.4;
/// Force that pulls the block, N.
const FORCE: f64 = 8.0;
/// Time for which it pulls, s.
const TIME: f64 = 0.25;
/// Gravity, m/s^2.
const GRAVITY: f64 = 9.80665;
/// Time for the block to come to rest before it is pulled, s.
const SETTLING: f64 = 0.3;
/// Greatest speed of a block at rest, m/s, a tenth of that below which friction is viscous.
const CREEP: f64 = 1e-4;
/// Time steps, ms.
const STEPS_OF_SLIDE: [f64; 4] = [2.5, 1.25, 0.625, 0.3125];

/// A block that is pulled over a floor.
pub const PULLED: Case = Case {
    name: "friction",
    title: "Block pulled over a floor",
    source: "PyElastica, examples/FrictionValidationCases/axial_friction.py (github.com/GazzolaLab/PyElastica, \
             commit 954532cb): the kinetic energy is t^2 (f - mu m g)^2 / (2 m), by C. A. de Coulomb (1785)",
    problem: "A body of 1 kg lies on a plane with kinetic friction 0.4 and is pulled by 8 N for 0.25 s. There it is \
              a rod; here it is a soft block of 20 x 2.5 x 20 cm and 100 kPa, which first comes to rest.",
    measure: friction,
};

/// A block that slides down a slope.
pub const SLOPE: Case = Case {
    name: "slope",
    title: "Block sliding down a slope",
    source: "the law of C. A. de Coulomb (1785): the acceleration is g (sin a - mu cos a)",
    problem: "The soft block of the case before, on a plane with friction 0.4, under gravity that is tilted by 30 \
              degrees. The acceleration is the mean over 0.25 s, after it has slid for 0.3 s.",
    measure: slope,
};

/// A soft block of 1 kg on a floor; `more` are further tables of its body.
fn block_on_floor(dt: f64, gravity: [f64; 3], more: &str) -> String {
    head(dt, gravity, 1e-6)
        + &format!(
            "[contact]\nfriction = {FRICTION:?}\n[[body]]\nname = \"block\"\n\
             layer = {{ box = [[0.0, 0.0, 0.0], [0.2, 0.025, 0.2]], cells = [8, 1, 8] }}\n\
             material = {{ young = 1e5, poisson = 0.4, density = 1000.0, damping_stiffness = 2e-3 }}\n{more}\
             [[body]]\nname = \"floor\"\nplane = [0, 1, 0, 0]\n"
        )
}

/// The speed along x after [`SETTLING`], and after [`TIME`] more, m/s.
fn speeds(run: &mut Run, dt: f64) -> Result<[f64; 2]> {
    let mut speed = |time: f64| {
        for _ in 0..(time / dt).round() as usize {
            run.step()?;
        }
        Ok(run.momentum()?.x / MASS)
    };
    Ok([speed(SETTLING)?, speed(TIME)?])
}

fn friction(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let pull = format!(
        "[[body.load]]\nname = \"pull\"\nforce = [{FORCE:?}, 0.0, 0.0]\nbind = {{ all = true }}\n\
         factors = [[{SETTLING:?}, 0.0], [{:?}, 1.0]]\n",
        SETTLING + 1e-6
    );
    let mut levels = Vec::new();
    for &ms in lab.levels(&STEPS_OF_SLIDE) {
        let dt = 1e-3 * ms;
        let text = block_on_floor(dt, [0.0, -GRAVITY, 0.0], &pull);
        let mut run = lab.open(&format!("steps of {ms} ms"), &text)?;
        let [before, speed] = speeds(&mut run, dt)?;
        if before.abs() > CREEP {
            return Err(Error::Simulation(format!("the block moves at {before:e} m/s before it is pulled")));
        }
        levels.push(run.level(ms, 0.5 * MASS * speed * speed));
    }
    let published = TIME.powi(2) / (2.0 * MASS) * (FORCE - FRICTION * MASS * GRAVITY).powi(2);
    let model = Model {
        uncertainty: 1e-3,
        reason: "friction is viscous below a speed of 1 mm/s, while the end speed is 1 m/s",
        ..Model::default()
    };
    let convergence = Convergence::Order(1.0, Function::Value);
    Ok(vec![Quantity { model, ..Quantity::new("kinetic energy", "J", published, convergence, levels) }])
}

fn slope(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let (sine, cosine) = (0.5, 0.75f64.sqrt());
    let mut levels = Vec::new();
    for &ms in lab.levels(&STEPS_OF_SLIDE) {
        let dt = 1e-3 * ms;
        let text = block_on_floor(dt, [GRAVITY * sine, -GRAVITY * cosine, 0.0], "");
        let mut run = lab.open(&format!("steps of {ms} ms"), &text)?;
        let [before, after] = speeds(&mut run, dt)?;
        levels.push(run.level(ms, (after - before) / TIME));
    }
    let published = GRAVITY * (sine - FRICTION * cosine);
    let convergence = Convergence::Order(1.0, Function::Value);
    Ok(vec![Quantity::new("acceleration", "m/s^2", published, convergence, levels)])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::accuracy::space::press::YOUNG;

    /// Force of a ball on a bonded layer over that of Hertz's law, and the indentation, for a contact of radius `a`,
    /// by the integral equation of frictionless contact. Lengths are in layer thicknesses.
    fn layer(a: f64, radius: f64) -> (f64, f64) {
        let kappa = 3.0 - 4.0 * POISSON;
        // One less the layer's response to a pressure of wave number k, relative to that of a half-space.
        let less = |k: f64| {
            let e = (-2.0 * k).exp();
            let response = kappa * (1.0 - e * e) - 4.0 * k * e;
            1.0 - response / (kappa * (1.0 + e * e) + (1.0 + kappa * kappa + 4.0 * k * k) * e)
        };
        let (count, step) = (800, 0.02);
        let waves: Vec<(f64, f64)> = (0..count).map(|i| (i as f64 + 0.5) * step).map(|k| (k, step * less(k))).collect();
        let kernel = |u: f64| waves.iter().map(|(k, weight)| weight * (k * u).cos()).sum::<f64>();
        let both = |t: f64, s: f64| (kernel(t - s) + kernel(t + s)) / PI;
        let points: Vec<f64> = (0..60).map(|i| (i as f64 + 0.5) / 60.0 * a).collect();
        let width = a / 60.0;
        let matrix: Vec<Vec<f64>> =
            points.iter().map(|t| points.iter().map(|s| width * both(*t, *s)).collect()).collect();
        let dot = |row: &[f64], x: &[f64]| row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
        // The operator is small, so that its series converges.
        let solve = |f: &dyn Fn(f64) -> f64| {
            let given: Vec<f64> = points.iter().map(|t| f(*t)).collect();
            (0..60).fold(given.clone(), |x, _| {
                matrix.iter().zip(&given).map(|(row, given)| given + dot(row, &x)).collect::<Vec<f64>>()
            })
        };
        let edge: Vec<f64> = points.iter().map(|s| width * both(a, *s)).collect();
        let (one, square) = (|_| 1.0, |t: f64| t * t / radius);
        let (of_one, of_square) = (solve(&one), solve(&square));
        // The pressure vanishes at the rim.
        let depth = (square(a) + dot(&edge, &of_square)) / (1.0 + dot(&edge, &of_one));
        let force: f64 = of_one.iter().zip(&of_square).map(|(one, square)| width * (depth * one - square)).sum();
        (2.0 * force / (4.0 / 3.0 * radius.sqrt() * depth.powf(1.5)), depth)
    }

    #[test]
    fn the_series_is_as_low_as_the_integral_equation_says() {
        let (mut low, mut high) = (0.1, 0.6);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            *(if layer(middle, RADIUS / HEIGHT).1 < DEPTH / HEIGHT { &mut low } else { &mut high }) = middle;
        }
        let plain = 4.0 / 3.0 * YOUNG / (1.0 - POISSON * POISSON) * RADIUS.sqrt() * DEPTH.powf(1.5);
        let excess = layer(low, RADIUS / HEIGHT).0 * plain / hertz(RADIUS, DEPTH, POISSON);
        assert!((excess - EXCESS).abs() < 1e-3, "the integral equation gives {excess} times the series");
        // A small contact is Hertz's.
        let (factor, _) = layer(0.01, 100.0);
        assert!((factor - 1.0).abs() < 0.02, "{factor}");
    }
}
