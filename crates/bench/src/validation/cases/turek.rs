//! The elastic bar of Turek and Hron: the benchmark of computational structural mechanics (CSM) within their
//! benchmark of fluid-structure interaction.

use glam::DVec3;
use palpate::Result;
use palpate::internal::prepare::Layer;

use super::super::lab::{Lab, Run};
use super::super::meshes::{Split, grid};
use super::super::series::{Convergence, Function, Level, Model, Quantity};
use super::{Case, head, support};

const SOURCE: &str = "S. Turek and J. Hron, \"Proposal for numerical benchmarking of fluid-structure interaction \
                      between an elastic object and laminar incompressible flow\" (2006), tests CSM1, CSM2 and CSM3; \
                      values and meshes at www.mathematik.tu-dortmund.de/~featflow";
/// Length of the bar on its middle line, m: from the surface of a cylinder, to which it is clamped, to its end.
const LENGTH: f64 = 0.35;
/// Radius of the cylinder, m.
const CYLINDER: f64 = 0.05;
const HEIGHT: f64 = 0.02;
const POISSON: f64 = 0.4;
const DENSITY: f64 = 1000.0;
const GRAVITY: f64 = 2.0;
/// Shear modulus of CSM1 and CSM3, and of CSM2, Pa.
const SOFT: f64 = 0.5e6;
const STIFF: f64 = 2.0e6;
/// Cells across the height.
const CELLS: [u32; 4] = [4, 6, 8, 16];
/// The greatest strain (half the height over the radius of curvature) is 2 % at rest and 4 % in the swing. The laws
/// differ by half the square of the strain of each fibre, which makes the moment of the one 0.3 times that square
/// greater.
const REASON: &str = "the law of St. Venant and Kirchhoff there, the corotational one here, which differ by the \
                      square of the strain";
/// Difference of the frequencies that the authors give for two of their own meshes and steps, 1.0956 and 1.0995 Hz.
const SPREAD: f64 = 0.0039;

/// Time after which the bar must have swung to its lowest point twice, s; by theory it is 1.4 s.
const LONGEST: f64 = 3.0;

/// Large deflection at rest.
pub const LARGE: Case = Case {
    name: "csm1",
    title: "Bar under its weight, large deflection (CSM1)",
    source: SOURCE,
    problem: "A bar of 0.35 x 0.02 m in plane strain is clamped to a cylinder of 5 cm radius and bends under gravity \
              of 2 m/s^2 by a fifth of its length. Shear modulus 0.5 MPa, Poisson's ratio 0.4, 1,000 kg/m^3. Here \
              one cell is wide, between planes of symmetry; steps of 100 ms with damping by mass lead to rest.",
    measure: |lab| at_rest(lab, SOFT, [[66.10e-3, 5e-6], [7.187e-3, 0.5e-6]]),
};

/// Small deflection at rest.
pub const SMALL: Case = Case {
    name: "csm2",
    title: "Bar under its weight, small deflection (CSM2)",
    source: SOURCE,
    problem: "As CSM1, with a shear modulus of 2 MPa.",
    measure: |lab| at_rest(lab, STIFF, [[16.97e-3, 5e-6], [0.4690e-3, 0.05e-6]]),
};

/// Free swinging.
pub const SWINGING: Case = Case {
    name: "csm3",
    title: "Bar swinging freely under its weight (CSM3)",
    source: SOURCE,
    problem: "The bar of CSM1 is let go from its straight shape, undamped. Steps are refined together with cells, \
              from 5 ms on; implicit Euler damps the swing by half the square of frequency times step in a step, \
              and lowers the frequency by a third of that square. The period is the time from the first to the \
              second lowest point of the end. Mean and amplitude, which are published too, are not compared, since \
              implicit Euler damps the swing.",
    measure: swinging,
};

/// The bar with this many cells across its height.
fn scene(lab: &Lab, cells: u32, shear: f64, [dt, tolerance]: [f64; 2], damping: f64) -> Result<String> {
    let (layer, clamped) = bar(cells);
    let file = lab.folder.layer(&format!("bar{cells}"), &layer.nodes, &layer.tetrahedra)?;
    let young = 2.0 * shear * (1.0 + POISSON);
    Ok(head(dt, [0.0, -GRAVITY, 0.0], tolerance)
        + &format!(
            "[[body]]\nname = \"bar\"\nlayer = {file:?}\n\
             material = {{ young = {young:?}, poisson = {POISSON:?}, density = {DENSITY:?}, \
             damping_mass = {damping:?} }}\n"
        )
        + &support("clamp", "point = true", &format!("{{ nodes = {clamped:?} }}"))
        + &support("strain", "plane = [0, 0, 1]", "{ all = true }"))
}

/// The bar, one cell wide, whose clamped end follows the cylinder, and the indices of the nodes there. The middle of
/// the clamped end is the origin.
fn bar(cells: u32) -> (Layer, Vec<usize>) {
    let size = HEIGHT / f64::from(cells);
    let along = (LENGTH / size).round() as u32;
    let half = 0.5 * HEIGHT;
    let (low, high) = (DVec3::new(0.0, -half, 0.0), DVec3::new(1.0, half, size));
    let mut layer = grid(low, high, [along, cells, 1], Split::Mirrored);
    let clamped = (0..layer.nodes.len()).filter(|&node| layer.nodes[node].x < 1e-9).collect();
    for node in &mut layer.nodes {
        let start = (CYLINDER * CYLINDER - node.y * node.y).sqrt() - CYLINDER;
        node.x = start + (LENGTH - start) * node.x;
    }
    (layer, clamped)
}

/// Displacement of the middle of the bar's end, m.
fn end(run: &Run) -> Result<DVec3> {
    run.displacement(DVec3::new(LENGTH, 0.0, 0.0))
}

/// Deflection and shortening at rest; of each the published value and half a unit of its last digit, m.
fn at_rest(lab: &mut Lab, shear: f64, published: [[f64; 2]; 2]) -> Result<Vec<Quantity>> {
    let mut levels: [Vec<Level>; 2] = [Vec::new(), Vec::new()];
    for &cells in lab.levels(&CELLS) {
        let label = format!("{cells} cells across");
        let text = scene(lab, cells, shear, [0.1, 1e-4], 10.0)?;
        // The damping keeps the bar from turning far in a step. The loose tolerance does not matter, because what a
        // solve leaves is part of the next one: with 1e-6 limits have the same five digits.
        let mut run = lab.open(&label, &text)?;
        run.rest(30, 1000)?;
        let end = end(&run)?;
        levels[0].push(run.level(1.0 / f64::from(cells), -end.y));
        levels[1].push(run.level(1.0 / f64::from(cells), -end.x));
    }
    let model = Model { uncertainty: 2e-4, reason: REASON, ..Model::default() };
    let quantity = |name: &str, [published, uncertainty]: [f64; 2], function, levels| Quantity {
        uncertainty,
        model: model.clone(),
        ..Quantity::new(name, "m", published, Convergence::Order(2.0, function), levels)
    };
    let ([down, back], [down_levels, back_levels]) = (published, levels);
    // A bent bar is shortened by the square of its deflection.
    Ok(vec![
        quantity("deflection of the end", down, Function::Reciprocal, down_levels),
        quantity("shortening", back, Function::ReciprocalRoot, back_levels),
    ])
}

fn swinging(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let dt = 0.02 / f64::from(cells);
        let label = format!("{cells} cells across, steps of {:.3} ms", 1e3 * dt);
        let text = scene(lab, cells, SOFT, [dt, 1e-6], 0.0)?;
        let mut run = lab.open(&label, &text)?;
        let mut lowest = Lowest::default();
        while lowest.count() < 2 && run.steps() as f64 * dt < LONGEST {
            run.step()?;
            lowest.add(end(&run)?.y, dt);
        }
        let frequency = lowest.period().map_or(f64::NAN, |period| 1.0 / period);
        levels.push(run.level(1.0 / f64::from(cells), frequency));
    }
    let model = Model { uncertainty: 1e-3, reason: REASON, ..Model::default() };
    let convergence = Convergence::Order(2.0, Function::Square);
    Ok(vec![Quantity { uncertainty: SPREAD, model, ..Quantity::new("frequency", "Hz", 1.0995, convergence, levels) }])
}

/// The lowest points of a motion that is sampled step by step, by parabolas through three samples.
#[derive(Debug, Default)]
struct Lowest {
    heights: Vec<f64>,
    times: Vec<f64>,
}

impl Lowest {
    /// The next sample, after `dt` s.
    fn add(&mut self, height: f64, dt: f64) {
        self.heights.push(height);
        if let [.., a, b, c] = *self.heights.as_slice()
            && b < a
            && b <= c
        {
            let middle = (self.heights.len() - 1) as f64;
            self.times.push(dt * (middle + 0.5 * (a - c) / (a - 2.0 * b + c)));
        }
    }

    /// Number of lowest points so far.
    fn count(&self) -> usize {
        self.times.len()
    }

    /// Mean time between two lowest points, s.
    fn period(&self) -> Option<f64> {
        match self.times.as_slice() {
            [first, .., last] => Some((last - first) / (self.times.len() - 1) as f64),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_period_of_a_cosine_is_found_between_samples() {
        let mut lowest = Lowest::default();
        for step in 1..400 {
            lowest.add((0.01 * f64::from(step) * 7.3).cos() * (-0.002 * f64::from(step)).exp(), 0.01);
        }
        assert_eq!(lowest.count(), 5);
        let (period, want) = (lowest.period().unwrap(), std::f64::consts::TAU / 7.3);
        assert!((period / want - 1.0).abs() < 1e-5, "period {period}, {want} expected");
    }
}
