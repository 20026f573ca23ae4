//! What texels and paths of the depth stage change: its time. Beside them what depths sampled at texels, as the paper has
//! them, would have cost.

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

/// Edges of the engine's squares, m.
const TEXELS: [f64; 6] = [1e-2, 5e-3, 3e-3, 2e-3, 1e-3, 5e-4];
/// And of the sampled ones.
const SAMPLED: [f64; 7] = [1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4];
const PATHS: [DepthPath; 2] = [DepthPath::Compute, DepthPath::Graphics];
/// Skin vertices of the head, in full and in short.
const VERTICES: [usize; 2] = [20_000, 8_000];
/// Of the ball, m.
const RADIUS: f64 = 0.02;
/// What the times are of.
const STAGES: &[&str] = &["depth"];
/// The engine's forces are those of its own choice in every step, bit for bit.
const BOUND: f64 = 0.0;
/// Title of the engine's plot, which is empty: zeros have no logarithm.
const ENGINE: &str = "the engine: rays, no error to draw";
/// And of that of sampled depths, whose time is no step's.
const CPU: &str = "depths at texels' middles, f64, CPU";

/// Squares of the depth stage by both paths, and sampled depths.
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
            "What do texels and paths change? A ball of 2 cm goes 3 mm into the cheek of a head of {vertices} skin vertices, with \
             squares of {} to {} mm, by compute and by graphics; against the engine's own choice. Beside it the same two skins, \
             not deformed, with depths taken at the middles of texels, as in the paper, against every vertex's own ray: \
             force of a penalty, both sides in half; its time is that of one such sum on the CPU in f64.",
            1e3 * TEXELS[0],
            1e3 * TEXELS[TEXELS.len() - 1]
        ),
        knob: "edge of a texel, m".into(),
        stage: STAGES.concat(),
        points,
        expected: None,
        span_reason: format!(
            "squares only share out the work, every vertex has its own ray: of {all} forces of steps {others} differ in a bit \
             from the reference's, and the errors that there are belong to sampled depths"
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

/// Whether the device has what a path needs.
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
            setting: format!("at middles, {} mm", 1e3 * texel),
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
