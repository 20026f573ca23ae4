//! The accuracy curves (error and computing time for the settings of one varied value) about resolution in space: cells
//! of the layer (tetrahedral mesh), vertices of skins (surface meshes), contact stiffness, texels, collision proxies.
//! In all of them a stiffly coupled ball is pressed into a body ([`press`]), and the contact force is compared once
//! everything is at rest.

mod layer;
mod limit;
mod press;
mod proxies;
mod sampled;
mod shapes;
mod skin;
mod stiffness;
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

/// An entrant, that is, a setting that is run against others: a press, the panel and line of its point, its name and
/// the knob's value.
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

/// Relative error of the magnitude of a run's force at rest; there is no error of displacements.
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
