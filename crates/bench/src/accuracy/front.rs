//! The curve `presets` of `palpate bench accuracy`. Its knobs (values of a scene that are varied) are the time step,
//! the number of Newton iterations, the solver tolerance and the contact sides (contact is found at the vertices of one
//! or of both bodies' skins, their surface meshes). They are varied together on a soft and on a stiff head, which a
//! sphere led by the haptic device presses. The curve shows which settings (combinations of the values) no other
//! setting beats in both error and cost; the presets of scenes are chosen from these settings ([`super::presets`]).

use glam::{DQuat, DVec3};
use palpate::scene::{Coupling, Key, Sides};
use palpate::{Result, Scene};

use super::race::{Entrant, Rules, race, relative_error};
use super::steps::{LONGEST, MANY, at_units, extrapolated};
use super::{Curve, Judged, Point, Settings, factor};
use crate::haptics;
use crate::haptics::head::{self, CHEEK, Skin};
use crate::solver::stiffness;

/// Name of the curve.
pub const NAME: &str = "presets";
/// Distance, into the cheek, from the position of the sphere at the first touch to the last position of the device, m.
const TRAVEL: f64 = 0.008;
/// Distance, away from the cheek, from the position of the sphere at the first touch to the first position of the
/// device, m.
const ABOVE: f64 = 0.0005;
/// Time in which the device moves from its first to its last position, in units of the longest time step ([`LONGEST`]).
const DOWN: f64 = 1.5;
/// Simulated time of a run, in units of the longest time step.
const UNITS: usize = 3;
/// Young's moduli of the head, Pa: that of flesh, and a hundred times that.
const YOUNG: [f64; 2] = [2e4, 2e6];
/// Solver tolerance and Newton iterations of the reference.
const TIGHT: (f64, u32) = (1e-5, 3);
/// Largest allowed error of the force of the most accurate setting on each head, as a share of the reference's largest
/// force.
const BOUND: f64 = 0.05;

/// The values of each knob that are combined; the finest value of a knob is last.
struct Grid {
    tolerances: &'static [f64],
    newton: &'static [u32],
    sides: &'static [(&'static str, Sides)],
    /// Number of the shortest time steps that are left out: the longest time step is halved at most
    /// [`Settings::halvings`] minus this many times.
    spared: u32,
}

/// The contact sides: contact is found at the vertices of the finer skin alone, or at those of both skins.
const SIDES: &[(&str, Sides)] = &[("one", Sides::One), ("both", Sides::Both)];
const FULL: Grid = Grid { tolerances: &[1e-1, 1e-2, 1e-3, 1e-4], newton: &[1, 2], sides: SIDES, spared: 1 };
const QUICK: Grid = Grid { tolerances: &[1e-1, 1e-2], newton: &[1, 2], sides: SIDES, spared: 2 };

/// Measures every combination of tolerance, Newton iterations, contact sides and time step on both heads.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let grid = if settings.is_quick { QUICK } else { FULL };
    let most = settings.halvings.saturating_sub(grid.spared).max(1);
    let (head, tetrahedra) = scene(settings)?;
    let at = |young: f64, halvings: u32, tolerance: f64, newton: u32, sides: Sides| {
        let mut scene = head.clone();
        scene.bodies.iter_mut().filter_map(|body| body.material.as_mut()).for_each(|material| material.young = young);
        (scene.solver.tolerance, scene.solver.max_iterations) = (Some(tolerance), MANY);
        (scene.contact.sides, scene.step.newton) = (sides, newton);
        scene.step.dt = LONGEST / f64::from(1u32 << halvings);
        scene
    };
    let options = settings.options();
    let (mut entrants, mut judges, mut references) = (Vec::new(), Vec::new(), Vec::new());
    for (head, young) in YOUNG.into_iter().enumerate() {
        watch(&format!("reference at {}", stiffness(young)));
        let fine = |halvings: u32| at(young, halvings, TIGHT.0, TIGHT.1, Sides::Both);
        references.push(extrapolated(&fine, most + 2, UNITS, &options)?);
        for halvings in 1..=most {
            for &(name, sides) in grid.sides {
                for (&newton, &tolerance) in
                    grid.newton.iter().flat_map(|n| grid.tolerances.iter().map(move |t| (n, t)))
                {
                    let scene = at(young, halvings, tolerance, newton, sides);
                    let point = point(&scene, name, stiffness(young));
                    entrants.push(Entrant { point, scene, steps: UNITS << halvings });
                    judges.push((head, halvings));
                }
            }
        }
    }
    let rules = Rules { rounds: settings.rounds.min(2), ..settings.rules(&["solve"], &options) };
    let points = race(entrants, &rules, watch, &mut |index, run| {
        let (head, halvings) = judges[index];
        (relative_error(&at_units(run, 1 << halvings), &references[head]), None)
    })?;
    Ok(Curve {
        name: NAME.into(),
        title: "All knobs at once".into(),
        question: format!(
            "Which settings does no other setting beat in both error and cost? A hand moves a sphere by {:.0} mm into \
             the cheek of a head ({} vertices, {tetrahedra} tetrahedra) with a Young's modulus of {} and of {}. Every \
             solver tolerance is combined with each number of Newton iterations, with contact at the vertices of one \
             or of both skins, and with each time step. The error is that of the force every {:.0} ms, against a \
             reference extrapolated to vanishing time steps.",
            1e3 * TRAVEL,
            settings.vertices,
            stiffness(YOUNG[0]),
            stiffness(YOUNG[1]),
            1e3 * LONGEST
        ),
        knob: "time step, ms".into(),
        stage: "solve".into(),
        span_reason: span_reason(&points),
        points,
        bound: BOUND,
        judged: Judged::FinestOfPanel,
        ..Curve::default()
    })
}

/// Reason, in words, for the span of the errors. It compares two factors: by how much the smallest errors of different
/// time steps differ, and by how much the errors within one time step differ. If the first factor is greater, the time
/// step causes most of the error.
fn span_reason(points: &[Point]) -> String {
    let least = |own: &[Point]| own.iter().filter_map(Point::error).fold(f64::INFINITY, f64::min);
    let (mut steps, mut others) = (1.0f64, 1.0f64);
    for panel in points.chunk_by(|a, b| a.panel == b.panel) {
        let lines = || panel.chunk_by(|a, b| a.line == b.line);
        steps = steps.max(factor(lines().map(least).filter(|error| error.is_finite())));
        others = lines().map(|own| factor(own.iter().filter_map(Point::error))).fold(others, f64::max);
    }
    let most = if steps > others {
        "most of the error is that of the time step"
    } else {
        "the time step does not cause most of the error"
    };
    format!(
        "{most}: the best errors of different time steps differ by a factor of {steps:.1}, those within one time step \
         by at most {others:.1}; time steps so short that the errors would span more would take too long to measure"
    )
}

fn point(scene: &Scene, sides: &str, panel: String) -> Point {
    let (dt, newton, tolerance) = (scene.step.dt, scene.step.newton, scene.solver.tolerance.unwrap_or(f64::NAN));
    let keys = [
        ("step.dt", format!("{dt:.6}")),
        ("step.newton", newton.to_string()),
        ("solver.tolerance", format!("{tolerance:e}")),
        ("contact.sides", sides.to_string()),
    ];
    Point {
        setting: format!(
            "{panel}, {:.2} ms, {newton} x to {tolerance:.0e}, {sides} side{}",
            1e3 * dt,
            if sides == "one" { "" } else { "s" }
        ),
        line: format!("{:.1} ms", 1e3 * dt),
        panel,
        value: 1e3 * dt,
        simulated_s: dt,
        keys: keys.map(|(key, value)| (key.to_string(), value)).to_vec(),
        ..Point::default()
    }
}

/// The scene of the pressed head, and the number of its tetrahedra.
fn scene(settings: &Settings) -> Result<(Scene, usize)> {
    let head = haptics::Settings { vertices: settings.vertices, cell: settings.cell, ..haptics::Settings::quick() };
    let at_origin = head::scene(&head, DVec3::ZERO);
    let touch = Skin::of(&at_origin)?.touch(CHEEK)?;
    let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
    let (start, end) = (touch + DVec3::Z * ABOVE, touch - DVec3::Z * TRAVEL);
    let mut scene = head::scene(&head, start);
    scene.coupling = Some(Coupling { stiffness: 500.0, damping: 5.0, angular_stiffness: 0.5, angular_damping: 0.002 });
    scene.trajectory = vec![key(0.0, start), key(DOWN * LONGEST, end)];
    // Without gravity, because a head that sags while it is pressed exerts a force that depends on the sagging too.
    scene.step.gravity = DVec3::ZERO;
    let body = crate::solver::prepared(&scene)?;
    let tetrahedra = crate::solver::layer(&body)?.tetrahedra.len();
    Ok((scene, tetrahedra))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_of_the_error_is_the_steps_only_where_it_is() {
        let at = |line: &str, error| Point { line: line.into(), force_error: Some(error), ..Point::default() };
        let told = span_reason(&[at("4 ms", 0.4), at("4 ms", 0.5), at("2 ms", 0.2), at("2 ms", 0.2)]);
        assert!(told.starts_with("most of") && told.contains("2.0") && told.contains("1.2"), "wrong reason: {told}");
        let told = span_reason(&[at("4 ms", 0.1), at("4 ms", 0.5), at("2 ms", 0.2), at("2 ms", 0.2)]);
        assert!(told.starts_with("the time step does not"), "wrong reason: {told}");
    }
}
