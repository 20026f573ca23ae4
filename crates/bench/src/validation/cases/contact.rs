//! Contact and friction: a ball pressed into a layer, and a block on a slope.

use glam::DVec3;
use palpate::Result;
use palpate::scene::Samples;

use super::super::lab::{Lab, Run};
use super::super::series::{Convergence, Level, Of, Quantity};
use super::{Case, head};
use crate::accuracy::space::layer::{block, fine_ball};
use crate::accuracy::space::press::{Body, Press, STEPS};
use crate::accuracy::space::stiffness::hertz;

/// Cells across the block.
const CELLS: [u32; 4] = [16, 20, 24, 32];
const RADIUS: f64 = 0.1;
const DEPTH: f64 = 0.002;
const POISSON: f64 = 0.3;
/// Contact stiffness with one cell across, N/m^3; it grows with the square of the number of cells.
const STIFFNESS: f64 = 1e6;

/// A rigid ball on a bonded layer.
pub const INDENTATION: Case = Case {
    name: "indentation",
    title: "Rigid ball pressed into a bonded layer",
    source: "E. K. Dimitriadis and others, \"Determination of elastic moduli of thin layers of soft material using \
             the atomic force microscope\" (2002), equation 13, a series on the law of H. Hertz (1882)",
    problem: "A ball of 10 cm radius is pressed 2 mm into a block of 12 x 4 x 12 cm whose bottom is bonded to a \
              rigid base (20 kPa, Poisson's ratio 0.3), cells three times as fine under the ball. Contact's penalty \
              is refined with the cells.",
    measure: indentation,
};

fn indentation(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let mut press = Press {
            poisson: POISSON,
            depth: DEPTH,
            radius: RADIUS,
            stiffness: Some(STIFFNESS * f64::from(cells * cells)),
            ..Press::new(Body::Based(None, block(&lab.folder, cells, DVec3::new(2.0, 1.0, 2.0))?))
        };
        press.ball = Some(fine_ball(&lab.folder, press.radius)?);
        let mut scene = press.scene();
        scene.file = "indentation".into();
        scene.contact.samples = Samples::Triangles;
        let mut run = lab.open_scene(&format!("{cells} cells across"), &scene)?;
        let mut force = f64::NAN;
        for _ in 0..STEPS {
            force = run.step()?.tool.map_or(f64::NAN, |tool| tool.force.y);
        }
        levels.push(run.level(1.0 / f64::from(cells), force));
    }
    Ok(vec![Quantity {
        name: "force".into(),
        unit: "N",
        published: hertz(RADIUS, DEPTH, POISSON),
        rounding: 0.0,
        model: 0.025,
        reason: "the series is 2.2 % low at this depth, by an f64 solution of the integral equation, and for a layer \
                 without sides"
            .into(),
        convergence: Convergence::Order(2.0, Of::Value),
        levels,
    }])
}

/// Mass of the block, kg, coefficient of friction and force, N, of PyElastica's case, and its time, s.
const MASS: f64 = 1.0;
const FRICTION: f64 = 0.4;
const FORCE: f64 = 8.0;
const TIME: f64 = 0.25;
/// Gravity there, m/s^2.
const GRAVITY: f64 = 9.80665;
/// Time for the block to come to rest before it is pulled, s.
const SETTLING: f64 = 0.3;
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
    problem: "The soft block of the case before lies on a slope of 30 degrees, with friction 0.4. The acceleration \
              is the mean over 0.25 s, after it has slid for 0.3 s.",
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
        let mut run = lab.open("friction", &format!("steps of {ms} ms"), &text)?;
        let [_, speed] = speeds(&mut run, dt)?;
        levels.push(run.level(ms, 0.5 * MASS * speed * speed));
    }
    let published = TIME.powi(2) / (2.0 * MASS) * (FORCE - FRICTION * MASS * GRAVITY).powi(2);
    Ok(vec![quantity("kinetic energy", "J", published, levels)])
}

fn slope(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let (sine, cosine) = (0.5, 0.75f64.sqrt());
    let mut levels = Vec::new();
    for &ms in lab.levels(&STEPS_OF_SLIDE) {
        let dt = 1e-3 * ms;
        let text = block_on_floor(dt, [GRAVITY * sine, -GRAVITY * cosine, 0.0], "");
        let mut run = lab.open("slope", &format!("steps of {ms} ms"), &text)?;
        let [before, after] = speeds(&mut run, dt)?;
        levels.push(run.level(ms, (after - before) / TIME));
    }
    Ok(vec![quantity("acceleration", "m/s^2", GRAVITY * (sine - FRICTION * cosine), levels)])
}

fn quantity(name: &str, unit: &'static str, published: f64, levels: Vec<Level>) -> Quantity {
    Quantity {
        name: name.into(),
        unit,
        published,
        rounding: 0.0,
        model: 1e-3,
        reason: "friction starts within a speed of 1 mm/s, while the end speed is 1 m/s".into(),
        convergence: Convergence::Order(1.0, Of::Value),
        levels,
    }
}
