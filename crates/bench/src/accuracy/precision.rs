//! The curve `precision` of `palpate bench accuracy`: the error of the force that single precision causes when a sphere
//! presses a block. The engine, with its solver as tight as single precision allows, is compared with the same steps of
//! the f64 reference implementation (the oracle). Each line of the curve varies one quantity: stiffness, size, offset
//! from the world's origin, or number of steps.

use palpate::Result;

use super::document::percent;
use super::press::Press;
use super::race::{Entrant, race};
use super::twin::{Reference, reference};
use super::{Curve, Judged, Point, Settings, factor};

/// Solver tolerance; single precision gains nothing from a tighter one.
const TIGHTEST: f64 = 1e-7;
/// Cap on the solver iterations of a step; high, since so tight a tolerance needs many.
const MANY: u32 = 2_000;
/// Cells of the blocks along x, y and z; few, because the oracle solves each f64 step directly, which takes long.
const CELLS: [u32; 3] = [6, 4, 6];
/// Young's moduli, Pa.
const YOUNG: [f64; 6] = [1e3, 1e4, 1e5, 1e6, 1e7, 1e8];
/// Edges of the block, m, where its size is varied.
const EDGES: [f64; 6] = [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0];
/// Offsets of the block from the world's origin, the same along x and z, m.
const OFFSETS: [f64; 6] = [0.1, 1.0, 10.0, 1e2, 1e3, 1e4];
/// Numbers of steps that are tried on the line `steps`, in tenths of the number of steps on the other lines.
const TENTHS: [usize; 6] = [5, 10, 20, 30, 40, 80];
/// Edge of the block where its size is not varied, m.
const EDGE: f64 = 0.1;
/// Largest allowed error of the force of any setting, as a share of the reference's largest force.
const BOUND: f64 = 1e-3;

/// The error changes little along a line if its largest value is at most this factor times its smallest value.
const LITTLE: f64 = 3.0;

/// Varies stiffness, size, offset and number of steps, one at a time, each from small to large.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let usual = Press { cells: CELLS, ..Press::default() };
    let steps = if settings.is_quick { settings.steps / 2 } else { settings.steps };
    let stiff = YOUNG.map(|young| ("stiffness", young, format!("{young:.0e} Pa"), Press { young, ..usual }, steps));
    let size = EDGES.map(|edge| ("size", edge, format!("{edge} m"), alike(edge / EDGE, &usual), steps));
    let far = OFFSETS.map(|offset| ("offset", offset, format!("{offset} m off"), Press { offset, ..usual }, steps));
    let long = TENTHS.map(|tenths| {
        let steps = (steps * tenths).div_ceil(10).max(1);
        ("steps", steps as f64, format!("{steps} steps"), usual, steps)
    });
    // The short form of the benchmark varies stiffness and offset only, because the f64 steps take long.
    let all = if settings.is_quick { [stiff, far].concat() } else { [stiff, size, far, long].concat() };
    let options = settings.options();
    let longest = all.iter().filter(|(line, ..)| *line == "steps").map(|(.., steps)| *steps).max().unwrap_or(0);
    let (mut references, mut entrants) = (Vec::<Reference>::new(), Vec::new());
    let mut of_steps: Option<Reference> = None;
    for (line, value, setting, press, steps) in all {
        watch(&format!("reference, {setting}"));
        let mut scene = press.scene();
        (scene.solver.tolerance, scene.solver.max_iterations) = (Some(TIGHTEST), MANY);
        references.push(match &of_steps {
            Some(longest) if line == "steps" => longest.clone(),
            _ if line == "steps" => of_steps.insert(reference(&scene, longest, &options)?).clone(),
            _ => reference(&scene, steps, &options)?,
        });
        let point = Point { setting, line: line.into(), panel: line.into(), value, ..Point::default() };
        entrants.push(Entrant { point, scene, steps });
    }
    let rules = settings.rules(&["solve"], &options);
    let points = race(entrants, &rules, watch, &mut |index, run| references[index].errors(run))?;
    Ok(Curve {
        name: "precision".into(),
        title: "Single against double precision".into(),
        question: format!(
            "How large is the error of the force that single precision causes, and where? A sphere presses a block \
             ({} tetrahedra, 20 kPa, edge {EDGE} m, {steps} steps of 1 ms, unless the setting says otherwise). The \
             solver's tolerance is {TIGHTEST:.0e}; the reference is the same steps in f64.",
            usual.tetrahedra()
        ),
        knob: "stiffness, Pa; size, m; offset, m; or steps".into(),
        stage: "solve".into(),
        span_reason: span_reason(&points),
        points,
        bound: BOUND,
        judged: Judged::Every,
        ..Curve::default()
    })
}

/// The press (scene of the sphere and the block) `usual`, scaled by `size`. All times are scaled too, so that the
/// motion is similar to that of `usual`.
fn alike(size: f64, usual: &Press) -> Press {
    Press { size, dt: size * usual.dt, seconds: size * usual.seconds, damping: size * usual.damping, ..*usual }
}

/// Reason, in words, for the span of the errors: the lines along which the error changes little and those along which
/// it changes much, each with the factor by which it changes.
fn span_reason(points: &[Point]) -> String {
    let (mut little, mut much) = (Vec::new(), Vec::new());
    for own in points.chunk_by(|a, b| a.line == b.line) {
        let errors = || own.iter().filter_map(|point| Some((point.error()?, point)));
        let by = factor(errors().map(|(error, _)| error));
        let told = format!("{} ({by:.1})", own[0].line);
        let most = errors().max_by(|a, b| a.0.total_cmp(&b.0));
        match most.filter(|_| by > LITTLE) {
            Some((error, point)) => much.push(format!("{told}, most at {} ({})", point.setting, percent(error))),
            None => little.push(told),
        }
    }
    let listed =
        |all: &[String], what: &str| if all.is_empty() { String::new() } else { format!("{what} {}", all.join(", ")) };
    let parts = [
        listed(&little, "the error changes little (factor in brackets) along"),
        listed(&much, "it changes much (factor in brackets) with"),
        "the remaining error is rounding".into(),
    ];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_measured_and_changes_little_is_said_to() {
        let point = |line: &str, error| Point {
            line: line.into(),
            setting: format!("{error}"),
            force_error: Some(error),
            ..Point::default()
        };
        let told = span_reason(&[point("stiffness", 1e-5), point("stiffness", 12.5e-5), point("offset", 1e-5)]);
        let (little, much) = told.split_once("; it changes").unwrap();
        assert!(little.contains("offset (1.0)") && !little.contains("stiffness"), "wrong reason: {told}");
        assert!(
            much.contains("stiffness (12.5)") && much.contains("0.000125") && !told.contains("size"),
            "wrong reason: {told}"
        );
        let told = span_reason(&[point("stiffness", 1e-5), point("stiffness", 1.2e-5)]);
        assert!(told.contains("little") && !told.contains("it changes"), "wrong reason: {told}");
    }
}
