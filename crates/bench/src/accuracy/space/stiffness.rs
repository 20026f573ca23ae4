//! How stiff contact must be: against the limit of ever stiffer contact on the same mesh, and against Hertz's law.

use glam::DVec3;
use palpate::Result;

use super::layer::{block, fine_ball};
use super::limit::limit;
use super::press::{Body, HEIGHT, Press, YOUNG};
use super::{entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Expected, Point, Settings};
use crate::meshes::MeshFolder;

/// N/m^3.
const STIFFNESSES: [f64; 10] = [1e4, 1e5, 1e6, 1e7, 3e7, 6e7, 1e8, 2e8, 3e8, 1e9];
/// The limit is extrapolated from two of them.
const LAST: [f64; 2] = [3e8, 1e9];
/// A penalty's depth is its pressure over its stiffness.
const ORDER: f64 = 1.0;
/// Cells across the block, in full and in short.
const CELLS: [u32; 2] = [16, 12];
/// What the mesh makes of Hertz's law is extrapolated from blocks of these cells, in full and in short.
const MESHES: [[u32; 2]; 2] = [[12, 24], [8, 12]];
/// Cells are finer by one more than this where the ball touches, which is a small place: several lie under it.
const GRADES: DVec3 = DVec3::new(2.0, 1.0, 2.0);
/// Without much locking, since the law has none.
const POISSON: f64 = 0.3;
/// Of the ball, m.
const RADIUS: f64 = 0.06;
/// Small beside ball and block, as the law wants, m.
const DEPTH: f64 = 0.001;
/// The stiffest contact, of the limit or the law.
const BOUND: f64 = 0.05;
/// What the times are of.
const STAGES: &[&str] = &["solve"];
const LIMIT: &str = "against ever stiffer contact";
const HERTZ: &str = "against Hertz's law";

/// Contact stiffness over five decades.
pub fn by_stiffness(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let folder = MeshFolder::new()?;
    let (cells, meshes) = (CELLS[usize::from(settings.is_quick)], MESHES[usize::from(settings.is_quick)]);
    let press = |cells: u32, stiffness: f64| -> Result<Press> {
        let mut press = Press {
            poisson: POISSON,
            depth: DEPTH,
            radius: RADIUS,
            ..Press::new(Body::Based(None, block(&folder, cells, GRADES)?))
        };
        press.ball = Some(fine_ball(&folder, press.radius)?);
        press.stiffness = Some(stiffness);
        Ok(press)
    };
    let mut last = [(0.0, 0.0); 2];
    for (last, stiffness) in last.iter_mut().zip(LAST) {
        watch(&format!("reference: {stiffness:.0e} N/m^3"));
        *last = (1.0 / stiffness, force(&press(cells, stiffness)?.scene(), settings)?);
    }
    let (limit_force, law) = (limit(last, ORDER), hertz(RADIUS));
    // What the mesh makes of the law, taken off: forces of two meshes, extrapolated.
    let stiffest = LAST[1];
    let mut by_mesh = [(0.0, 0.0); 2];
    for (by_mesh, cells) in by_mesh.iter_mut().zip(meshes) {
        watch(&format!("reference: {cells} cells across"));
        *by_mesh = (1.0 / f64::from(cells), force(&press(cells, stiffest)?.scene(), settings)?);
    }
    let mesh = last[1].1 / limit(by_mesh, 2.0);
    let all = STIFFNESSES.map(|stiffness| {
        let setting = format!("{stiffness:.0e} N/m^3, {LIMIT}");
        Ok(entrant(&press(cells, stiffness)?, LIMIT, "", setting, 1.0 / stiffness))
    });
    let entrants = all.into_iter().collect::<Result<Vec<Entrant>>>()?;
    let options = settings.options();
    let rules = settings.rules(STAGES, &options);
    let mut by_law = Vec::new();
    let mut points = race(entrants, &rules, watch, &mut |_, run| {
        // The law knows no mesh.
        by_law.push(error_against(law * mesh, run).0);
        error_against(limit_force, run)
    })?;
    let again = points.clone().into_iter().zip(by_law).map(|(point, force_error)| Point {
        setting: point.setting.replace(LIMIT, HERTZ),
        panel: HERTZ.into(),
        force_error,
        ..point
    });
    points.extend(again.collect::<Vec<_>>());
    Ok(Curve {
        name: "stiffness".into(),
        title: "Contact stiffness".into(),
        question: format!(
            "How stiff must contact be for the force to be the body's? A ball of 6 cm goes 1 mm into a block of {cells} x {} x \
             {cells} cells (12 x 4 x 12 cm, 20 kPa, nu 0.3). The limit, {limit_force:.4} N, is extrapolated from {:.0e} and \
             {:.0e} N/m^3. Hertz's law, for a layer on a base as Dimitriadis and others (2002) have it, says {law:.4} N; \
             the mesh makes that {:.1} % more, by {} and {} cells extrapolated, which is taken off.",
            cells.div_ceil(2),
            LAST[0],
            LAST[1],
            100.0 * (mesh - 1.0),
            meshes[0],
            meshes[1]
        ),
        knob: "one over the contact stiffness, m^3/N".into(),
        stage: STAGES.concat(),
        points,
        expected: Some(Expected {
            order: ORDER,
            law: "a spring gives way by its pressure over its stiffness".into(),
            is_of_shape: false,
        }),
        order_reason:
            "the springs' way is small beside the ball's only at last; against the law an error of its own and of the \
                       mesh is left"
                .into(),
        span_reason: "at the softest the error is the whole force, which is the most that it can be".into(),
        bound: BOUND,
        ..Curve::default()
    })
}

/// Force of a rigid ball pressed [`DEPTH`] into a layer that is bonded to a rigid base: Hertz's law with the series of
/// Dimitriadis, Horkay, Maresca, Kachar and Chadwick (2002, equation 13), N.
fn hertz(radius: f64) -> f64 {
    let nu = POISSON;
    let a = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let b = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let x = (radius * DEPTH).sqrt() / HEIGHT;
    let pi = std::f64::consts::PI;
    let series = 1.0 - 2.0 * a / pi * x + 4.0 * a * a / (pi * pi) * x * x
        - 8.0 / pi.powi(3) * (a.powi(3) + 4.0 * pi * pi / 15.0 * b) * x.powi(3)
        + 16.0 * a / pi.powi(4) * (a.powi(3) + 3.0 * pi * pi / 5.0 * b) * x.powi(4);
    4.0 / 3.0 * YOUNG / (1.0 - nu * nu) * radius.sqrt() * DEPTH.powf(1.5) * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_of_a_layer_is_hertzs_with_a_little_more() {
        let plain = 4.0 / 3.0 * YOUNG / (1.0 - POISSON * POISSON) * 0.06f64.sqrt() * DEPTH.powf(1.5);
        let ratio = hertz(0.06) / plain;
        assert!((0.9..1.5).contains(&(ratio / 1.1)) && ratio > 1.1, "{ratio}");
        // By hand: 1 + 0.8806 x + 0.7754 x^2 + 0.2298 x^3 - 0.296 x^4 at x = sqrt(6e-5) / 0.04.
        let x: f64 = 6e-5f64.sqrt() / 0.04;
        let by_hand = 1.0 + 0.8806 * x + 0.7754 * x * x + 0.2298 * x.powi(3) - 0.296 * x.powi(4);
        assert!((ratio - by_hand).abs() < 1e-3, "{ratio} {by_hand}");
    }
}
