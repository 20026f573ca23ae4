//! Pictures of the state at the end of a run, for `report.html`, the page of the run: the whole scene, and, where a
//! force acts on the tool (the rigid body that the haptic device leads), the contact from nearby. The pictures are
//! rendered after the last step, when all results have been read, and so change none of the results.

use crate::engine::Engine;
use crate::report::Tally;
use crate::report::page::Shot;

#[cfg(feature = "view")]
mod rendered {
    use glam::DVec3;
    use palpate::{Result, Simulation};
    use palpate_view::{Camera, Overlay, Overlays, Settings, Studio};

    use crate::film::SAMPLES;
    use crate::report::Tally;
    use crate::report::page::Shot;

    /// Width and height of each picture, pixels.
    const SIZE: [u32; 2] = [640, 480];
    /// Height of what the picture from nearby shows if the tool is a sphere, in radii of this sphere.
    const HEIGHT: f64 = 12.0;
    /// Distance from which a tool that is no sphere is seen, as a share of the distance from which the whole scene is
    /// seen.
    const NEARER: f64 = 0.4;
    /// Wanted angle between the force on the tool and the direction from the tool to the camera, rad: the contact is
    /// seen from the side and a little from above the touched surface.
    const ASIDE: f64 = 1.1;

    pub fn pictures(simulation: &mut Simulation, tally: &Tally) -> Result<Vec<Shot>> {
        let mut studio = Studio::new(simulation, Settings { size: SIZE, samples: SAMPLES })?;
        let force = tally.touch.as_ref().map(|touch| touch.last_force).filter(|force| force.length() > 0.0);
        let touches = force.is_some() || tally.last_contacts.is_some_and(|contacts| contacts > 0);
        if touches {
            studio.shown = Overlays::of(&[Overlay::Pressure, Overlay::Arrows]);
        }
        let mut shots = vec![shot(&mut studio, simulation, "The scene at the end of the run.")?];
        if let (Some(force), Some(tool)) = (force, simulation.tool().map(|tool| tool.centre)) {
            let radius = simulation.scene().tool.as_ref().and_then(|tool| tool.shape.radius());
            studio.camera = aimed(studio.camera, tool, force, radius);
            let caption = "The contact at the end: pressure as colours, the force on the tool as an arrow.";
            shots.push(shot(&mut studio, simulation, caption)?);
        }
        Ok(shots)
    }

    fn shot(studio: &mut Studio, simulation: &mut Simulation, caption: &'static str) -> Result<Shot> {
        let picture = studio.picture(simulation)?;
        let mut png = Vec::new();
        let failed = |source| palpate::Error::Output { file: "the picture of the page".into(), source };
        picture.write_png(&mut png).map_err(failed)?;
        Ok(Shot { png, size: SIZE, caption })
    }

    /// The camera of the picture from nearby. It looks at the tool at an angle of about [`ASIDE`] to the force, and is
    /// turned as little as possible from the direction of `whole`, the camera that shows the whole scene.
    fn aimed(whole: Camera, tool: DVec3, force: DVec3, radius: Option<f64>) -> Camera {
        let near = radius.map_or(NEARER * whole.distance, |radius| 0.5 * HEIGHT * radius / (0.5 * whole.fovy).tan());
        let at = Camera { target: tool, distance: near.min(whole.distance), ..whole };
        let turned =
            (0..72).flat_map(|turn| [0.0, 0.3, 0.6].map(|pitch| (f64::from(turn - 36).to_radians() * 5.0, pitch)));
        let cameras = turned.map(|(turn, pitch)| (turn, Camera { yaw: whole.yaw + turn, pitch, ..at }));
        let cost = |(turn, camera): &(f64, Camera)| {
            (force.angle_between(-camera.axes().forward) - ASIDE).abs() + 0.1 * turn.abs()
        };
        cameras.min_by(|a, b| cost(a).total_cmp(&cost(b))).map_or(at, |(_, camera)| camera)
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn the_contact_is_seen_from_the_side_of_the_force() {
            let whole = Camera::around(DVec3::splat(-0.1), DVec3::splat(0.1));
            for force in [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Z, DVec3::new(-1.0, 0.5, 0.2)] {
                let camera = aimed(whole, DVec3::splat(0.05), force, Some(0.01));
                let angle = force.angle_between(camera.eye() - camera.target);
                assert!((angle - ASIDE).abs() < 0.35, "force {force}: the angle to the camera is {angle} rad");
                assert!(camera.distance < whole.distance && camera.target == DVec3::splat(0.05));
            }
            let camera = aimed(whole, DVec3::ZERO, DVec3::Y, Some(10.0));
            assert_eq!(camera.distance, whole.distance, "a large tool must not be seen from further away");
        }
    }
}

/// Renders the pictures; the error says in words why there are none.
#[cfg(feature = "view")]
pub fn pictures(engine: &mut Engine, tally: &Tally) -> Result<Vec<Shot>, String> {
    rendered::pictures(engine.simulation_mut(), tally).map_err(|error| format!("No picture could be rendered: {error}"))
}

/// Renders nothing; the error says that this program was built without rendering.
#[cfg(not(feature = "view"))]
pub fn pictures(_: &mut Engine, _: &Tally) -> Result<Vec<Shot>, String> {
    Err("This program was built without pictures: build it with the feature `view` to have them here.".into())
}
