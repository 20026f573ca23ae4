//! What single precision costs: the engine, as tight as it can be asked for, against the same steps in f64.

use super::press::Press;
use super::race::{Entrant, Rules, race};
use super::twin::{Reference, reference};
use super::{Curve, Point, Settings};
use crate::Result;

/// As tight as a scene can ask for with a purpose.
const TIGHTEST: f64 = 1e-7;
/// And iterations for it.
const MANY: u32 = 2_000;
/// Of the blocks: f64 steps are solved directly, which takes long.
const CELLS: [u32; 3] = [6, 4, 6];
/// Young's moduli, Pa.
const YOUNG: [f64; 6] = [1e3, 1e4, 1e5, 1e6, 1e7, 1e8];
/// Edges of the block, m.
const EDGES: [f64; 6] = [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0];
/// Of the block from the world's origin, along x and z, m.
const OFFSETS: [f64; 6] = [0.1, 1.0, 10.0, 1e2, 1e3, 1e4];
/// Steps, of the usual number, over 10.
const TENTHS: [usize; 6] = [5, 10, 20, 30, 40, 80];
/// Edge of the usual block, m.
const EDGE: f64 = 0.1;
/// The force that is found best along each way, of the reference's.
const BOUND: f64 = 1e-3;

/// Stiffness, size, place and number of steps, each from little to much.
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
    // A first look goes two of the ways: f64 steps take long.
    let all = if settings.is_quick { [stiff, far].concat() } else { [stiff, size, far, long].concat() };
    let options = settings.options();
    let longest = all.iter().filter(|(line, ..)| *line == "steps").map(|(.., steps)| *steps).max().unwrap_or(0);
    let (mut references, mut entrants) = (Vec::<Reference>::new(), Vec::new());
    let mut of_steps: Option<Reference> = None;
    for (line, value, setting, press, steps) in all {
        watch(&format!("reference, {setting}"));
        let mut scene = press.scene();
        (scene.solver.tolerance, scene.solver.max_iterations) = (TIGHTEST, MANY);
        references.push(match &of_steps {
            Some(longest) if line == "steps" => longest.clone(),
            _ if line == "steps" => of_steps.insert(reference(&scene, longest, &options)?).clone(),
            _ => reference(&scene, steps, &options)?,
        });
        let point = Point { setting, line: line.into(), panel: line.into(), value, ..Point::default() };
        entrants.push(Entrant { point, scene, steps });
    }
    let rules = Rules { rounds: settings.rounds, stages: &["solve"], options: &options };
    let points = race(entrants, &rules, watch, &mut |index, run| references[index].errors(run))?;
    Ok(Curve {
        name: "precision".into(),
        title: "Single against double precision".into(),
        question: format!(
            "How much of the force is lost to single precision, and where? The sphere and the block ({} tetrahedra, 20 kPa, \
             {EDGE} m, {steps} steps of 1 ms unless the setting says another), the solver to {TIGHTEST:.0e}, against the \
             same steps in f64.",
            usual.tetrahedra()
        ),
        knob: "Pa, m, m or steps".into(),
        stage: "solve".into(),
        reason: reason(&points),
        points,
        bound: BOUND,
        ..Curve::default()
    })
}

/// The press of another size, in times that make the motion the same but for it.
fn alike(size: f64, usual: &Press) -> Press {
    Press { size, dt: size * usual.dt, seconds: size * usual.seconds, damping: size * usual.damping, ..*usual }
}

/// Along which way the error changes by what factor.
fn reason(points: &[Point]) -> String {
    let one = |own: &[Point]| {
        let errors = || own.iter().filter_map(Point::error);
        let factor = errors().fold(0.0, f64::max) / errors().fold(f64::INFINITY, f64::min);
        format!("{factor:.1} along {}", own[0].line)
    };
    let all: Vec<String> = points.chunk_by(|a, b| a.line == b.line).map(one).collect();
    format!(
        "rounding is all that is left, and changes little from case to case, by a factor of {}: positions are measured from \
         the tool and displacements from rest, so that neither place nor size enters",
        all.join(", ")
    )
}
