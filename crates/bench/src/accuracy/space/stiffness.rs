//! The curve `stiffness` of `palpate bench accuracy`: how stiff penalty contact must be when a ball is pressed into a
//! block. The contact force is compared with its limit for ever stiffer contact on the same mesh, and with Hertz's law.

use glam::DVec3;
use palpate::Result;

use super::layer::{block, fine_ball};
use super::press::{Body, HEIGHT, Press, YOUNG};
use super::{entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Expected, Point, Settings};
use crate::limit::limit;
use crate::meshes::MeshFolder;

/// Contact stiffnesses that are tried, N/m^3.
const STIFFNESSES: [f64; 10] = [1e4, 1e5, 1e6, 1e7, 3e7, 6e7, 1e8, 2e8, 3e8, 1e9];
/// The two stiffnesses from which the limit is extrapolated, N/m^3.
const LAST: [f64; 2] = [3e8, 1e9];
/// Order of convergence of the force in the reciprocal of the contact stiffness: the depth of a penalty contact is its
/// pressure over its stiffness.
const ORDER: f64 = 1.0;
/// Cells across the block: in the whole benchmark and in its short form.
const CELLS: [u32; 2] = [16, 12];
/// Cells across the two blocks from which the error of the mesh is extrapolated: in the whole benchmark and in its
/// short form.
const MESHES: [[u32; 2]; 2] = [[12, 24], [8, 12]];
/// Where the ball touches the block, cells are finer than even ones by the factor 1 + this along each axis: the contact
/// area is small, and several cells should lie under it.
const GRADES: DVec3 = DVec3::new(2.0, 1.0, 2.0);
/// Poisson's ratio; so low that elements hardly lock, since Hertz's law does not include locking.
const POISSON: f64 = 0.3;
/// Radius of the ball, m.
const RADIUS: f64 = 0.06;
/// Depth to which the ball is pressed, m; small compared with ball and block, as Hertz's law assumes.
const DEPTH: f64 = 0.001;
/// Largest allowed relative error of the force with the stiffest contact, against the limit and against Hertz's law.
const BOUND: f64 = 0.05;
/// Stages of a time step whose times are summed.
const STAGES: &[&str] = &["solve"];
const LIMIT: &str = "against ever stiffer contact";
const HERTZ: &str = "against Hertz's law";

/// Measures the force for contact stiffnesses that span five powers of ten.
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
    let (limit_force, law) = (limit(last, ORDER), hertz(RADIUS, DEPTH, POISSON));
    // The factor by which a mesh of `cells` cells is too stiff: its force with the stiffest contact over the limit of
    // that force for vanishing cells.
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
        // Hertz's law is for a continuum, so its force is multiplied by the factor by which the mesh is too stiff.
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
            "How stiff must contact be so that the force is determined by the body? A ball of 6 cm radius goes 1 mm \
             into a block of {cells} x {} x {cells} cells (12 x 4 x 12 cm, 20 kPa, nu 0.3). The limit, \
             {limit_force:.4} N, is extrapolated from {:.0e} and {:.0e} N/m^3. Hertz's law, for a layer bonded to a \
             rigid base (Dimitriadis and others 2002), gives {law:.4} N; the mesh is {:.1} % too stiff (extrapolated \
             from {} and {} cells), and the law's force is multiplied accordingly.",
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
            law: "the depth of a penalty contact is its pressure over its stiffness".into(),
            is_of_shape: false,
        }),
        order_reason:
            "the penalty depth is small compared with the indentation only for the stiffest contacts; against Hertz's \
             law, the errors of the law and of the mesh remain"
                .into(),
        span_reason: "for the softest contact the error is the whole force, the largest possible".into(),
        bound: BOUND,
        ..Curve::default()
    })
}

/// Force of a rigid ball pressed `depth` into a layer of thickness [`HEIGHT`] and Young's modulus [`YOUNG`] bonded to a
/// rigid base, N; lengths in m. It is Hertz's law times a series in x, which is the square root of radius times depth,
/// divided by the thickness (Dimitriadis, Horkay, Maresca, Kachar and Chadwick 2002, equation 13).
pub fn hertz(radius: f64, depth: f64, nu: f64) -> f64 {
    let a = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let b = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let x = (radius * depth).sqrt() / HEIGHT;
    let pi = std::f64::consts::PI;
    let series = 1.0 - 2.0 * a / pi * x + 4.0 * a * a / (pi * pi) * x * x
        - 8.0 / pi.powi(3) * (a.powi(3) + 4.0 * pi * pi / 15.0 * b) * x.powi(3)
        + 16.0 * a / pi.powi(4) * (a.powi(3) + 3.0 * pi * pi / 5.0 * b) * x.powi(4);
    4.0 / 3.0 * YOUNG / (1.0 - nu * nu) * radius.sqrt() * depth.powf(1.5) * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_of_a_layer_is_hertzs_with_a_little_more() {
        let plain = 4.0 / 3.0 * YOUNG / (1.0 - POISSON * POISSON) * 0.06f64.sqrt() * DEPTH.powf(1.5);
        let ratio = hertz(0.06, DEPTH, POISSON) / plain;
        assert!(
            (0.9..1.5).contains(&(ratio / 1.1)) && ratio > 1.1,
            "force divided by that of Hertz's law for a body of infinite depth: {ratio}, expected 1.1 to 1.65"
        );
        // The series at x = sqrt(6e-5) / 0.04, with its coefficients for nu = 0.3 computed by hand.
        let x: f64 = 6e-5f64.sqrt() / 0.04;
        let by_hand = 1.0 + 0.8806 * x + 0.7754 * x * x + 0.2298 * x.powi(3) - 0.296 * x.powi(4);
        assert!((ratio - by_hand).abs() < 1e-3, "factor on Hertz's law: {ratio}; by hand: {by_hand}");
    }
}
