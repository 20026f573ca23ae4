//! The curves `time-step` and `newton` of `palpate bench accuracy`: the error of the force on a sphere that is pressed
//! into a block, and the computing time, for ever shorter time steps, and for ever more Newton iterations.

use glam::DVec3;
use palpate::scene::MaterialLaw;
use palpate::{Options, Result, Scene};

use super::press::Press;
use super::race::{Entrant, Run, race, relative_error, run};
use super::twin::{Reference, reference};
use super::{Curve, Expected, Point, SINGLE, Settings};

/// The longest time step, s: 30 steps a second. Shorter time steps are this one halved repeatedly, so that at the end
/// of every longest step a step of each shorter length ends too.
pub const LONGEST: f64 = 0.033;
/// Numbers of Newton iterations of a step that are tried.
const NEWTON: [u32; 8] = [1, 2, 3, 4, 5, 6, 7, 8];
/// Number of Newton iterations of a step in the reference run; more iterations change nothing.
const CONVERGED: u32 = 14;
/// Solver tolerance of both curves; tight, because neither curve is about the solver.
const TIGHT: f64 = 1e-6;
/// Cap on the number of solver iterations; solves to this module's tolerances need fewer.
pub const MANY: u32 = 2_000;
/// Largest allowed relative error of the force with the shortest step.
const STEP_BOUND: f64 = 0.02;
/// Largest allowed relative error of the force with the most Newton iterations.
const NEWTON_BOUND: f64 = 1e-3;

/// Measures the force at the end of each longest step ([`LONGEST`]) for ever shorter time steps, against the limit of
/// the force for vanishing time steps.
pub fn by_time_step(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let (units, beyond) = if settings.is_quick { (5, 1) } else { (9, 2) };
    let most = settings.halvings;
    let scene = |halvings: u32| {
        let dt = LONGEST / f64::from(1u32 << halvings);
        let press = Press { cells: settings.cells, dt, seconds: 3.0 * LONGEST, hand_damping: 8.0, ..Press::default() };
        tight(press.scene(), 1)
    };
    let options = settings.options();
    watch("reference");
    let reference = extrapolated(&scene, most + beyond, units, &options)?;
    let entrant = |halvings: u32| {
        let scene = scene(halvings);
        let dt = scene.step.dt;
        let setting = format!("{:.3} ms", 1e3 * dt);
        let point = Point { setting, value: 1e3 * dt, simulated_s: dt, ..Point::default() };
        Entrant { point, scene, steps: units << halvings }
    };
    let rules = settings.rules(&["solve"], &options);
    let entrants = (0..=most).map(entrant).collect();
    let points = race(entrants, &rules, watch, &mut |halvings, run| {
        (relative_error(&at_units(run, 1 << halvings), &reference), None)
    })?;
    let order_reason = format!(
        "the longest step is a third of the press, so that errors of higher order matter; at {} the order is {}",
        points.last().map_or("", |point| &point.setting),
        super::curve::last_order(&points).map_or("cannot be determined".into(), |order| format!("{order:.2}"))
    );
    let shortest = 1e3 * LONGEST / f64::from(1u32 << (most + beyond));
    Ok(Curve {
        name: "time-step".into(),
        title: "Time step".into(),
        question: format!(
            "What does a shorter time step buy? A sphere is pressed 5 mm into a block ({} tetrahedra) in {:.0} ms and \
             then held. The force is compared every {:.0} ms; the reference is extrapolated to vanishing steps from \
             steps of {shortest:.3} ms and of twice that.",
            tetrahedra(settings),
            3e3 * LONGEST,
            1e3 * LONGEST
        ),
        knob: "time step, ms".into(),
        stage: "solve".into(),
        points,
        expected: Some(Expected { order: 1.0, law: "implicit Euler".into(), ..Expected::default() }),
        order_reason,
        span_reason: format!(
            "between time steps with a ratio of {}, a first-order error falls by no more than {:.1} powers of ten",
            1u32 << most,
            f64::from(1u32 << most).log10()
        ),
        bound: STEP_BOUND,
        ..Curve::default()
    })
}

/// Measures a deep press into a very soft block in long steps with different numbers of Newton iterations, for two
/// material laws.
pub fn by_newton(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let steps = if settings.is_quick { 9 } else { 12 };
    let scene = |law: MaterialLaw, newton: u32| {
        let deep =
            Press { cells: settings.cells, young: 5e3, dt: 0.01, travel: 0.02, seconds: 0.08, ..Press::default() };
        tight(Press { law, ..deep }.scene(), newton)
    };
    let options = settings.options();
    let laws = [("corotational", MaterialLaw::Corotational), ("neo-Hookean", MaterialLaw::NeoHookean)];
    let mut references: Vec<Reference> = Vec::new();
    for (name, law) in laws {
        watch(&format!("reference, {name}"));
        references.push(reference(&scene(law, CONVERGED), steps, &options)?);
    }
    let of = |(name, law): (&'static str, MaterialLaw)| {
        NEWTON.map(|newton| {
            let setting = format!("{name}, {newton}");
            let point = Point { setting, line: name.into(), value: newton.into(), ..Point::default() };
            Entrant { point, scene: scene(law, newton), steps }
        })
    };
    let rules = settings.rules(&["elastic", "solve"], &options);
    let points = race(laws.into_iter().flat_map(of).collect(), &rules, watch, &mut |index, run| {
        references[index / NEWTON.len()].errors(run)
    })?;
    Ok(Curve {
        name: "newton".into(),
        title: "Newton's iterations".into(),
        question: format!(
            "What do further Newton iterations of a step gain? A sphere is pressed some 15 mm into a block of 5 kPa \
             ({} tetrahedra) in {steps} steps of 10 ms; the reference is steps in f64 with {CONVERGED} iterations.",
            tetrahedra(settings)
        ),
        knob: "Newton's iterations".into(),
        stage: "elastic and solve".into(),
        points,
        span_reason: SINGLE.into(),
        share: "the tangent stiffness leaves out the derivative of the elements' rotations".into(),
        bound: NEWTON_BOUND,
        ..Curve::default()
    })
}

fn tetrahedra(settings: &Settings) -> u32 {
    Press { cells: settings.cells, ..Press::default() }.tetrahedra()
}

fn tight(mut scene: Scene, newton: u32) -> Scene {
    (scene.solver.tolerance, scene.solver.max_iterations, scene.step.newton) = (Some(TIGHT), MANY, newton);
    scene
}

/// The forces at the ends of `units` longest steps ([`LONGEST`]) in the limit of vanishing time steps: Richardson
/// extrapolation of a first-order error from two runs. The time step of one run is the longest step halved `halvings`
/// times; that of the other is halved once less.
pub fn extrapolated(
    scene: &dyn Fn(u32) -> Scene,
    halvings: u32,
    units: usize,
    options: &Options,
) -> Result<Vec<DVec3>> {
    let forces = |halvings: u32| -> Result<Vec<DVec3>> {
        Ok(at_units(&run(&scene(halvings), units << halvings, options)?, 1 << halvings))
    };
    let (fine, coarse) = (forces(halvings)?, forces(halvings - 1)?);
    Ok(fine.iter().zip(&coarse).map(|(fine, coarse)| 2.0 * *fine - *coarse).collect())
}

/// The forces at the ends of the longest steps ([`LONGEST`]) in a run; one longest step takes as long as `steps` steps
/// of the run.
pub fn at_units(run: &Run, steps: usize) -> Vec<DVec3> {
    run.forces.chunks_exact(steps).filter_map(|unit| unit.last().copied()).collect()
}
