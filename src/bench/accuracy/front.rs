//! All knobs at once, on a head that a sphere presses: which settings nothing beats, and three of them by name.

use glam::{DQuat, DVec3};

use super::document::{digits, ms, percent};
use super::race::{Entrant, Rules, race, relative_error};
use super::steps::{LONGEST, MANY, at_units, extrapolated};
use super::{Curve, JUST_NOTICEABLE, Point, Settings};
use crate::Result;
use crate::bench::haptics::head::{self, CHEEK, Skin};
use crate::bench::{Section, Table, haptics};
use crate::scene::{Coupling, Key, Scene, Sides};

/// Of the curve.
pub const NAME: &str = "presets";
/// From the first touch of the cheek to where the hand ends, m.
const TRAVEL: f64 = 0.008;
/// Above the first touch, m.
const ABOVE: f64 = 0.0005;
/// Longest steps that the way down takes, and that a run has.
const DOWN: f64 = 1.5;
const UNITS: usize = 3;
/// Of the reference.
const TIGHT: (f64, u32) = (1e-5, 3);
/// The force of the most accurate setting, of the reference's.
const BOUND: f64 = 0.05;
/// Names, and below which error the cheapest setting has each: what is just noticed, its half, its quarter.
pub const PRESETS: [(&str, f64); 3] =
    [("fast", JUST_NOTICEABLE), ("balanced", JUST_NOTICEABLE / 2.0), ("accurate", JUST_NOTICEABLE / 4.0)];

struct Grid {
    tolerances: &'static [f64],
    newton: &'static [u32],
    sides: &'static [(&'static str, Sides)],
    /// Of the longest step, but for these of the settings.
    spared: u32,
}

const SIDES: &[(&str, Sides)] = &[("both", Sides::Both), ("one", Sides::One)];
const FULL: Grid = Grid { tolerances: &[1e-1, 1e-2, 1e-3, 1e-4], newton: &[1, 2], sides: SIDES, spared: 1 };
const QUICK: Grid = Grid { tolerances: &[1e-1, 1e-3], newton: &[1, 2], sides: SIDES, spared: 2 };

/// Tolerance, Newton's iterations, contact's sides and time step, each with each.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let grid = if settings.is_quick { QUICK } else { FULL };
    let (scene, tetrahedra) = scene(settings)?;
    let most = settings.halvings.saturating_sub(grid.spared).max(1);
    let at = |halvings: u32, tolerance: f64, newton: u32, sides: Sides| {
        let mut scene = scene.clone();
        (scene.solver.tolerance, scene.solver.max_iterations) = (tolerance, MANY);
        (scene.contact.sides, scene.step.newton) = (sides, newton);
        scene.step.dt = LONGEST / f64::from(1u32 << halvings);
        scene
    };
    let mut entrants = Vec::new();
    for halvings in 1..=most {
        for &(name, sides) in grid.sides {
            for (&newton, &tolerance) in grid.newton.iter().flat_map(|n| grid.tolerances.iter().map(move |t| (n, t))) {
                let scene = at(halvings, tolerance, newton, sides);
                let point = point(&scene, name);
                entrants.push((halvings, Entrant { point, scene, steps: UNITS << halvings }));
            }
        }
    }
    let options = settings.options();
    watch("reference");
    let fine = |halvings: u32| at(halvings, TIGHT.0, TIGHT.1, Sides::Both);
    let reference = extrapolated(&fine, most + 2, UNITS, &options)?;
    let (halvings, entrants): (Vec<u32>, Vec<Entrant>) = entrants.into_iter().unzip();
    let rules = Rules { rounds: settings.rounds.min(2), stages: &["solve"], options: &options };
    let points = race(entrants, &rules, watch, &mut |index, run| {
        (relative_error(&at_units(run, 1 << halvings[index]), &reference), None)
    })?;
    Ok(Curve {
        name: NAME.into(),
        title: "All knobs at once".into(),
        question: format!(
            "Which settings does nothing beat? A sphere is pressed {:.0} mm into the cheek of a head ({} vertices, \
             {tetrahedra} tetrahedra); every tolerance with each number of Newton's iterations, one or both of contact's sides, and \
             each time step; the force every {:.0} ms against shorter steps, extrapolated to none.",
            1e3 * TRAVEL,
            settings.vertices,
            1e3 * LONGEST
        ),
        knob: "time step, ms".into(),
        stage: "solve".into(),
        reason: reason(&points),
        points,
        bound: BOUND,
        is_one: true,
        ..Curve::default()
    })
}

/// How far settings of the same time step are apart.
fn reason(points: &[Point]) -> String {
    let one = |own: &[Point]| {
        let errors = || own.iter().filter_map(Point::error);
        errors().fold(0.0, f64::max) / errors().fold(f64::INFINITY, f64::min)
    };
    let most = points.chunk_by(|a, b| a.line == b.line).map(one).fold(1.0, f64::max);
    format!(
        "most of the error is the time step's: other knobs change it by a factor of {most:.1} at most, and steps as short as \
         to span more are not worth their time here"
    )
}

fn point(scene: &Scene, sides: &str) -> Point {
    let (dt, newton, tolerance) = (scene.step.dt, scene.step.newton, scene.solver.tolerance);
    let keys = [
        ("step.dt", format!("{dt:.6}")),
        ("step.newton", newton.to_string()),
        ("solver.tolerance", format!("{tolerance:e}")),
        ("contact.sides", sides.to_string()),
    ];
    Point {
        setting: format!(
            "{:.2} ms, {newton} x to {tolerance:.0e}, {sides} side{}",
            1e3 * dt,
            if sides == "one" { "" } else { "s" }
        ),
        line: format!("{:.1} ms", 1e3 * dt),
        value: 1e3 * dt,
        simulated_s: dt,
        keys: keys.map(|(key, value)| (key.to_string(), value)).to_vec(),
        ..Point::default()
    }
}

/// The head, pressed, and its tetrahedra.
fn scene(settings: &Settings) -> Result<(Scene, usize)> {
    let head = haptics::Settings { vertices: settings.vertices, cell: settings.cell, ..haptics::Settings::quick() };
    let at_origin = head::scene(&head, DVec3::ZERO);
    let touch = Skin::of(&at_origin)?.touch(CHEEK)?;
    let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
    let (start, end) = (touch + DVec3::Z * ABOVE, touch - DVec3::Z * TRAVEL);
    let mut scene = head::scene(&head, start);
    scene.coupling = Some(Coupling { stiffness: 500.0, damping: 5.0, angular_stiffness: 0.5, angular_damping: 0.002 });
    scene.drive = vec![key(0.0, start), key(DOWN * LONGEST, end)];
    // A head that sags under its weight while it is pressed would say more of the sag.
    scene.step.gravity = DVec3::ZERO;
    let body = crate::bench::solver::prepared(&scene)?;
    let tetrahedra = crate::bench::solver::layer(&body)?.tetrahedra.len();
    Ok((scene, tetrahedra))
}

/// The setting that has each preset's name: the cheapest unflagged one below its error.
pub fn presets(curve: &Curve) -> [(&'static str, f64, Option<&Point>); 3] {
    PRESETS.map(|(name, below)| {
        let fits = |point: &&Point| point.flags.is_empty() && point.error().is_some_and(|error| error < below);
        let cheapest = curve.points.iter().filter(fits).min_by(|a, b| a.cost().total_cmp(&b.cost()));
        (name, below, cheapest)
    })
}

/// The presets as a table.
pub fn section(curve: &Curve) -> Section {
    let keys: Vec<String> =
        curve.points.first().map_or(Vec::new(), |point| point.keys.iter().map(|(key, _)| key.clone()).collect());
    let heads = ["preset", "error below"].map(String::from).into_iter().chain(keys.iter().cloned());
    let heads = heads.chain(["ms", "of real time", "error"].map(String::from));
    let mut table = Table::new(heads);
    let mut found = Vec::new();
    for (name, below, point) in presets(curve) {
        let mut row = vec![name.to_string(), percent(below)];
        match point {
            Some(point) => {
                row.extend(point.keys.iter().map(|(_, value)| value.clone()));
                row.extend([ms(point.step_ms()), digits(point.cost()), point.error().map_or(String::new(), percent)]);
                found.push(format!("`{name}` is {} ({} of real time)", point.setting, digits(point.cost())));
            }
            None => {
                row.resize(keys.len() + 5, "none".into());
                found.push(format!("no setting is below the {} of `{name}`", percent(below)));
            }
        }
        table.rows.push(row);
    }
    Section {
        title: "Presets".into(),
        question:
            "Which settings should a scene get that names a preset? Of the settings above without flags, the cheapest \
                   whose error is below the preset's. A part of real time below one is faster than the world."
                .into(),
        table,
        plot: None,
        finding: format!("{}.", found.join("; ")),
    }
}
