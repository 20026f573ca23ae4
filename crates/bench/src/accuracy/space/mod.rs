//! The accuracy curves (error and computing time for the settings of one varied value, the knob) about resolution in
//! space. The varied values are the cells of the layer (tetrahedral mesh), the vertices of the skins (surface meshes),
//! the contact stiffness, the texels (cells of the depth stage's grid) and the collision proxies (convex hulls). For
//! all these curves a stiffly coupled ball is pressed into a body ([`press`]), and the contact force is compared with a
//! reference once everything is at rest.

mod layer;
pub(crate) mod press;
mod proxies;
mod sampled;
pub(crate) mod shapes;
mod skin;
pub(crate) mod stiffness;
mod texel;

pub use layer::by_layer;
pub use proxies::by_proxies;
pub use skin::{by_sides, by_skin};
pub use stiffness::by_stiffness;
pub use texel::by_texel;

use glam::DVec3;
use palpate::{Result, Scene};

use super::race::{self, Entrant, Errors, Run};
use super::{Point, Settings};
use press::Press;

/// Makes an entrant, that is, a setting that is run alternately with others. `press` makes its scene, `panel` (plot)
/// and `line` say where its point is drawn, `setting` is its name, and `value` is its value of the knob.
fn entrant(press: &Press, panel: &str, line: &str, setting: String, value: f64) -> Entrant {
    let point = Point { setting, panel: panel.into(), line: line.into(), value, ..Point::default() };
    Entrant { point, scene: press.scene(), steps: press::STEPS }
}

/// The force on the ball after the last step, when everything is at rest, N.
fn at_rest(run: &Run) -> DVec3 {
    run.forces.last().copied().unwrap_or(DVec3::NAN)
}

/// Runs a scene by itself and returns the magnitude of the force at rest, N.
fn force(scene: &Scene, settings: &Settings) -> Result<f64> {
    Ok(at_rest(&race::run(scene, press::STEPS, &settings.options())?).length())
}

/// Relative error of the magnitude of a run's force at rest, against the magnitude `reference`; there is no error of
/// the displacements.
fn error_against(reference: f64, run: &Run) -> Errors {
    let error = (at_rest(run).length() - reference).abs() / reference.abs();
    (error.is_finite().then_some(error), None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_is_judged_by_its_size_and_no_number_has_no_error() {
        let run = |forces: Vec<DVec3>| {
            let mut run = Run::default();
            run.forces = forces;
            run
        };
        assert_eq!(error_against(2.0, &run(vec![DVec3::X, DVec3::new(0.0, 0.0, 1.5)])), (Some(0.25), None));
        assert_eq!(error_against(2.0, &run(vec![])), (None, None));
    }
}
