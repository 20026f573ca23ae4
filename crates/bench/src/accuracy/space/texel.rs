//! The curve `texel` of `palpate bench accuracy`. It shows that two choices change the computing time, not the force of
//! a ball that is pressed into a head. One is the cell size (`contact.texel`) of the min-max depth grid, which keeps
//! the least and greatest height of both skins (surface meshes) in each cell. The other is the path of the depth stage:
//! its implementation by compute shaders or by the graphics pipeline. For comparison the curve also shows the error of
//! depths sampled at texel centres, as in the paper of Galoppo and others (2007).

use std::time::Instant;

use glam::DVec3;
use palpate::internal::prepare::{self, Shape, sphere};
use palpate::scene::DepthPath;
use palpate::{Error, Result};
use palpate_oracle::skin;

use super::entrant;
use super::press::{Body, Press};
use super::sampled::Pose;
use crate::accuracy::race::{self, Entrant, race};
use crate::accuracy::{Curve, Judged, Point, Settings};

/// Cell sizes of the engine's min-max depth grid, m.
const TEXELS: [f64; 6] = [1e-2, 5e-3, 3e-3, 2e-3, 1e-3, 5e-4];
/// Texel sizes of the sampled depths, m.
const SAMPLED: [f64; 7] = [1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4];
const PATHS: [DepthPath; 2] = [DepthPath::Compute, DepthPath::Graphics];
/// Number of vertices of the head's skin: in the whole benchmark and in its short form.
const VERTICES: [usize; 2] = [20_000, 8_000];
/// Radius of the ball, m.
const RADIUS: f64 = 0.02;
/// Stages of a time step whose times are summed.
const STAGES: &[&str] = &["depth"];
/// Largest allowed relative error of the engine's forces: in every step they must equal, bit for bit, the forces with
/// the cell size that the engine chooses.
const BOUND: f64 = 0.0;
/// Title of the panel (plot) of the engine's forces; nothing is drawn there, since errors of zero have no logarithm.
const ENGINE: &str = "the engine: exact rays, no error to draw";
/// Title of the panel of sampled depths, which is not judged. The times in it are those of computing one force on the
/// CPU, not those of steps.
const CPU: &str = "depths at the centres of texels, f64, CPU";

/// Measures the depth stage with different cell sizes on both paths, and the error of sampled depths.
pub fn by_texel(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let vertices = VERTICES[usize::from(settings.is_quick)];
    let press = Press { radius: RADIUS, ..Press::new(Body::Head(vertices, None)) };
    let options = settings.options();
    watch("reference");
    let reference = race::run(&by_path(&press, PATHS[0], None), super::press::STEPS, &options)?;
    let mut entrants: Vec<Entrant> = Vec::new();
    for path in PATHS.into_iter().filter(|path| *path == PATHS[0] || can(&press, *path, settings)) {
        for texel in TEXELS {
            let setting = format!("{}, {} mm", path.name(), 1e3 * texel);
            let scene = by_path(&press, path, Some(texel));
            entrants.push(Entrant { scene, ..entrant(&press, ENGINE, path.name(), setting, texel) });
        }
    }
    let rules = settings.rules(STAGES, &options);
    let mut others = 0;
    let mut points = race(entrants, &rules, watch, &mut |_, run| {
        others += run.forces.iter().zip(&reference.forces).filter(|(a, b)| a != b).count();
        (race::relative_error(&run.forces, &reference.forces), None)
    })?;
    let all = points.len() * reference.forces.len();
    watch("sampled depths");
    points.extend(sampled(&press, settings.rounds)?);
    Ok(Curve {
        name: "texel".into(),
        title: "Size of texels, and path of the depth stage".into(),
        question: format!(
            "What changes with the size of texels and with the path (implementation) of the depth stage? A ball of 2 \
             cm radius goes 3 mm into the cheek of a head of {vertices} skin vertices, with cells of {} to {} mm in \
             the min-max depth grid, by compute and by graphics; the reference has the cell size that the engine \
             chooses. For comparison: the force of a penalty contact between the same two skins, not deformed, with \
             depths taken at the centres of texels, as in the paper, against depths by a ray from every vertex. The \
             time given for it is that of computing one such force on the CPU in f64.",
            1e3 * TEXELS[0],
            1e3 * TEXELS[TEXELS.len() - 1]
        ),
        knob: "edge of a texel, m".into(),
        stage: STAGES.concat(),
        points,
        expected: None,
        span_reason: format!(
            "grid cells only divide the work, and every vertex has its own ray: of {all} forces (one for each step) \
             {others} differ in a bit from the reference's, and all errors are those of sampled depths"
        ),
        bound: BOUND,
        judged: Judged::Every,
        beside: CPU.into(),
        ..Curve::default()
    })
}

fn by_path(press: &Press, path: DepthPath, texel: Option<f64>) -> palpate::Scene {
    let mut scene = press.scene();
    scene.contact.depth = Some(path);
    scene.contact.texel = texel;
    scene
}

/// Whether the GPU device can run the depth stage on this path.
fn can(press: &Press, path: DepthPath, settings: &Settings) -> bool {
    race::run(&by_path(press, path, None), 1, &settings.options()).is_ok()
}

fn sampled(press: &Press, rounds: usize) -> Result<Vec<Point>> {
    let scene = press.scene();
    let body = scene.bodies.first().ok_or_else(|| Error::Simulation("a press without a body".into()))?;
    let Shape::Soft { skin: head, .. } = prepare::body(body, &scene)?.shape else {
        return Err(Error::Simulation("a press of a body that is not soft".into()));
    };
    let (centre, normal) = press.pressed();
    let (mut ball, faces) = sphere::icosphere(RADIUS);
    ball.iter_mut().for_each(|x: &mut DVec3| *x += centre);
    let areas = [skin::areas(&head.vertices, &head.triangles), skin::areas(&ball, &faces)];
    let poses = [
        Pose { first: (&head.vertices, &head.triangles, &areas[0]), second: (&ball, &faces), normal },
        Pose { first: (&ball, &faces, &areas[1]), second: (&head.vertices, &head.triangles), normal: -normal },
    ];
    let exact: f64 = poses.iter().map(Pose::exact).sum();
    let one = |texel: f64| {
        let mut point = Point {
            setting: format!("at centres, {} mm", 1e3 * texel),
            panel: CPU.into(),
            value: texel,
            ..Point::default()
        };
        for _ in 0..rounds.max(1) {
            let begun = Instant::now();
            let found: f64 = poses.iter().map(|pose| pose.sampled(texel)).sum();
            let us = begun.elapsed().as_secs_f64() * 1e6;
            point.force_error = Some((found / exact - 1.0).abs()).filter(|error| error.is_finite());
            point.step_us.push(vec![us]);
            point.stage_us.push(vec![us]);
        }
        point
    };
    Ok(SAMPLED.map(one).to_vec())
}
