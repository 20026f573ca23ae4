//! What the solver's tolerance and its cap on iterations buy, against f64 steps solved directly.

use super::press::Press;
use super::race::{Entrant, Rules, race};
use super::twin::{Reference, reference};
use super::{Curve, Expected, Point, Settings};
use crate::Result;
use crate::bench::solver::stiffness;
use crate::scene::{Preconditioner, Scene};

/// Young's moduli of the blocks, Pa.
const YOUNG: [f64; 2] = [2e4, 2e6];
/// Residuals to stop at.
const TOLERANCES: [f64; 7] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// With which preconditioners.
const PRECONDITIONERS: [(&str, Preconditioner); 3] =
    [("jacobi", Preconditioner::Jacobi), ("coarse", Preconditioner::Coarse), ("auto", Preconditioner::Auto)];
/// Iterations at most.
const CAPS: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Iterations that a tolerance may take.
const MANY: u32 = 2_000;
/// Of the cap's curve: below what its longest runs reach.
const TIGHT: f64 = 1e-5;
/// The force of the tightest setting, of the reference's.
const BOUND: f64 = 1e-3;
/// What the times are of.
const STAGES: &[&str] = &["solve"];

fn press(settings: &Settings, young: f64) -> Press {
    Press { cells: settings.cells, young, ..Press::default() }
}

/// In short only what a user gets and the plainest.
fn preconditioners(settings: &Settings) -> impl Iterator<Item = &'static (&'static str, Preconditioner)> {
    let is_quick = settings.is_quick;
    PRECONDITIONERS.iter().filter(move |(_, kind)| !is_quick || *kind != Preconditioner::Coarse)
}

/// Residual to stop at, with every preconditioner, on a soft and on a stiff block.
pub fn by_tolerance(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let of = |young: f64| {
        preconditioners(settings).flat_map(move |&(name, kind)| {
            TOLERANCES.map(|tolerance| {
                let mut scene = press(settings, young).scene();
                scene.solver.preconditioner = kind;
                scene.solver.tolerance = tolerance;
                scene.solver.max_iterations = MANY;
                let setting = format!("{}, {name} to {tolerance:.0e}", stiffness(young));
                (young, scene, point(young, setting, name, tolerance))
            })
        })
    };
    let points = compared(YOUNG.into_iter().flat_map(of).collect(), settings, watch)?;
    let law = "the error of a linear system is proportionate to its residual".into();
    let expected = Expected { order: 1.0, law, is_of_shape: true };
    Ok(Curve {
        name: "tolerance".into(),
        title: "Solver tolerance and preconditioner".into(),
        question: question(
            "How small a residual does the force need, and which preconditioner gets there first?",
            settings,
        ),
        knob: "relative residual to stop at".into(),
        stage: STAGES.concat(),
        points,
        expected: Some(expected),
        bound: BOUND,
        ..Curve::default()
    })
}

/// Iterations at most, to a tolerance that few of them reach.
pub fn by_iterations(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let of = |young: f64| {
        CAPS.map(|cap| {
            let mut scene = press(settings, young).scene();
            scene.solver.tolerance = TIGHT;
            scene.solver.max_iterations = cap;
            let setting = format!("{}, at most {cap}", stiffness(young));
            (young, scene, point(young, setting, "auto", cap.into()))
        })
    };
    let points = compared(YOUNG.into_iter().flat_map(of).collect(), settings, watch)?;
    Ok(Curve {
        name: "iterations".into(),
        title: "Cap on the solver's iterations".into(),
        share: "conjugate gradients, by the condition of the system".into(),
        question: question("What is lost where a step may not take the iterations that it needs?", settings),
        knob: "iterations at most".into(),
        stage: STAGES.concat(),
        points,
        bound: BOUND,
        ..Curve::default()
    })
}

fn point(young: f64, setting: String, line: &str, value: f64) -> Point {
    Point { setting, line: line.into(), panel: stiffness(young), value, ..Point::default() }
}

fn question(asked: &str, settings: &Settings) -> String {
    format!(
        "{asked} A sphere is pressed 5 mm into a block with a fixed bottom ({} tetrahedra, {} steps of 1 ms), against f64 \
         steps solved directly.",
        press(settings, 1.0).tetrahedra(),
        settings.steps
    )
}

fn compared(all: Vec<(f64, Scene, Point)>, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Point>> {
    let options = settings.options();
    let mut references: Vec<(f64, Reference)> = Vec::new();
    for young in YOUNG {
        watch(&format!("reference at {}", stiffness(young)));
        references.push((young, reference(&press(settings, young).scene(), settings.steps, &options)?));
    }
    let youngs: Vec<f64> = all.iter().map(|(young, ..)| *young).collect();
    let entrants = all.into_iter().map(|(_, scene, point)| Entrant { point, scene, steps: settings.steps }).collect();
    let rules = Rules { rounds: settings.rounds, stages: STAGES, options: &options };
    race(entrants, &rules, watch, &mut |index, run| {
        let own = references.iter().find(|(young, _)| *young == youngs[index]);
        own.map_or((None, None), |(_, reference)| reference.errors(run))
    })
}
