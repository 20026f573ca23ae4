//! The curves `tolerance` and `iterations` of `palpate bench accuracy`: the error of the force on a sphere that is
//! pressed into a block, and the computing time, for each tolerance of the linear solver, and for each cap on the
//! number of its iterations. The reference is the same steps by the f64 reference implementation (the oracle), which
//! solves each linear system directly.

use palpate::scene::Preconditioner;
use palpate::{Result, Scene};

use super::press::Press;
use super::race::{Entrant, race};
use super::twin::{Reference, reference};
use super::{Curve, Expected, Point, SINGLE, Settings};
use crate::solver::stiffness;

/// Young's moduli of the blocks, Pa.
const YOUNG: [f64; 2] = [2e4, 2e6];
/// Solver tolerances (relative residuals at which to stop) that are tried.
const TOLERANCES: [f64; 7] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Preconditioners, by their names in a scene file.
const PRECONDITIONERS: [(&str, Preconditioner); 3] =
    [("jacobi", Preconditioner::Jacobi), ("coarse", Preconditioner::Coarse), ("auto", Preconditioner::Auto)];
/// Caps on the number of solver iterations of a step that are tried.
const CAPS: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Cap on the number of solver iterations where the tolerance is varied.
const MANY: u32 = 2_000;
/// Solver tolerance where the cap is varied; few of the capped solves reach it.
const TIGHT: f64 = 1e-5;
/// Largest allowed relative error of the force with the tightest setting.
const BOUND: f64 = 1e-3;
/// An error is much less than another if it is less by more than this factor.
const MUCH: f64 = 2.0;
/// Stages of a time step whose times are summed.
const STAGES: &[&str] = &["solve"];

fn press(settings: &Settings, young: f64) -> Press {
    Press { cells: settings.cells, young, ..Press::default() }
}

/// The preconditioners to measure: in the short form of the benchmark only the default (`auto`) and the simplest one.
fn preconditioners(settings: &Settings) -> impl Iterator<Item = &'static (&'static str, Preconditioner)> {
    let is_quick = settings.is_quick;
    PRECONDITIONERS.iter().filter(move |(_, kind)| !is_quick || *kind != Preconditioner::Coarse)
}

/// Varies the solver's tolerance, with every preconditioner, on a soft and on a stiff block.
pub fn by_tolerance(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let of = |young: f64| {
        preconditioners(settings).flat_map(move |&(name, kind)| {
            TOLERANCES.map(|tolerance| {
                let mut scene = press(settings, young).scene();
                scene.solver.preconditioner = kind;
                scene.solver.tolerance = Some(tolerance);
                scene.solver.max_iterations = MANY;
                let setting = format!("{}, {name} to {tolerance:.0e}", stiffness(young));
                (young, scene, point(young, setting, name, tolerance))
            })
        })
    };
    let points = compared(YOUNG.into_iter().flat_map(of).collect(), settings, watch)?;
    let law = "the error of a linear system's solution is proportional to its residual".into();
    let expected = Expected { order: 1.0, law, is_of_shape: true };
    Ok(Curve {
        name: "tolerance".into(),
        title: "Solver tolerance and preconditioner".into(),
        question: question(
            "How small must the residual be for an accurate force, and which preconditioner reaches it first?",
            settings,
        ),
        knob: "relative residual to stop at".into(),
        stage: STAGES.concat(),
        order_reason: order_reason(&points),
        span_reason: SINGLE.into(),
        points,
        expected: Some(expected),
        bound: BOUND,
        ..Curve::default()
    })
}

/// Varies the cap on the solver's iterations, at a tolerance that few of the capped solves reach.
pub fn by_iterations(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let of = |young: f64| {
        CAPS.map(|cap| {
            let mut scene = press(settings, young).scene();
            scene.solver.tolerance = Some(TIGHT);
            scene.solver.max_iterations = cap;
            let setting = format!("{}, at most {cap}", stiffness(young));
            (young, scene, point(young, setting, "auto", cap.into()))
        })
    };
    let points = compared(YOUNG.into_iter().flat_map(of).collect(), settings, watch)?;
    Ok(Curve {
        name: "iterations".into(),
        title: "Cap on the solver's iterations".into(),
        span_reason: SINGLE.into(),
        share: "convergence of conjugate gradients, by the condition number of the system".into(),
        question: question(
            "How large is the error if a step may not do all solver iterations that it needs?",
            settings,
        ),
        knob: "iterations at most".into(),
        stage: STAGES.concat(),
        points,
        bound: BOUND,
        ..Curve::default()
    })
}

/// Reason why the error of the displacements (the shape) may not fall with the residual. A preconditioner may leave a
/// much smaller error than Jacobi does even at the loosest tolerance; then little is left between that error and the
/// rounding error of single precision.
fn order_reason(points: &[Point]) -> String {
    let lines = points.chunk_by(|a, b| (&a.panel, &a.line) == (&b.panel, &b.line)).filter_map(|own| own.first());
    let lines: Vec<(&Point, f64)> = lines.filter_map(|point| Some((point, point.displacement_error?))).collect();
    let less = |(point, error): &(&Point, f64)| {
        let jacobi =
            lines.iter().find(|(other, _)| other.panel == point.panel && other.line == PRECONDITIONERS[0].0)?;
        let times = jacobi.1 / error;
        (times > MUCH).then(|| format!("{times:.0} times less with {} at {}", point.line, point.panel))
    };
    let less: Vec<String> = lines.iter().filter_map(less).collect();
    if less.is_empty() {
        return "few settings lie between the loosest and the floor of single precision".into();
    }
    format!(
        "the residual norm, weighted by the diagonal alone, is hardly affected by the smooth errors that make up the \
         error of the shape; the coarse level removes these first, so that at the loosest tolerance less error of the \
         shape is left than with Jacobi ({}), and little remains above the floor of single precision",
        less.join(", ")
    )
}

fn point(young: f64, setting: String, line: &str, value: f64) -> Point {
    Point { setting, line: line.into(), panel: stiffness(young), value, ..Point::default() }
}

fn question(asked: &str, settings: &Settings) -> String {
    format!(
        "{asked} A sphere is pressed 5 mm into a block with a fixed bottom ({} tetrahedra, {} steps of 1 ms); the \
         reference is the same steps in f64, solved directly.",
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
    let rules = settings.rules(STAGES, &options);
    race(entrants, &rules, watch, &mut |index, run| {
        let own = references.iter().find(|(young, _)| *young == youngs[index]);
        own.map_or((None, None), |(_, reference)| reference.errors(run))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coarse_level_is_blamed_only_where_it_leaves_less() {
        let at = |line: &str, error| Point { displacement_error: Some(error), ..point(2e6, String::new(), line, 0.1) };
        let told = order_reason(&[at("jacobi", 1.2e-3), at("jacobi", 1e-4), at("auto", 1e-4)]);
        assert!(told.contains("12 times less with auto at 2 MPa"), "wrong reason: {told}");
        let told = order_reason(&[at("jacobi", 1.2e-3), at("auto", 1.2e-3)]);
        assert!(told.starts_with("few settings") && !told.contains("coarse level"), "wrong reason: {told}");
    }
}
