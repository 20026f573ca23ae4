//! The soft head of `assets/scenes/touch-head.toml` with a sphere as the tool (rigid body that the haptic device
//! leads), and positions in which the tool touches the head's skin (its surface mesh).

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{self, Shape};
use palpate::scene::{self, Bind, Core, Dilatation, Layer, Material, MaterialLaw, Model, Motion, Surface, Tool};
use palpate::{Error, Options, Result, Scene, Simulation};

use super::Settings;
use super::rig::{MASS, RADIUS};

/// Distance of the points at which triangles are sampled, m.
const SAMPLED: f64 = 5e-4;

/// Point (x, y) at which the cheek is pressed, m.
pub const CHEEK: [f64; 2] = [0.03, -0.02];

/// A scene with the head and with the tool, whose centre starts at `centre` (m).
pub fn scene(settings: &Settings, centre: DVec3) -> Scene {
    let material = Material {
        young: 2e4,
        poisson: 0.45,
        density: 1000.0,
        damping_mass: 0.0,
        damping_stiffness: 0.002,
        law: MaterialLaw::Corotational,
    };
    let surface = Surface::Model { model: Model::Head, vertices: settings.vertices };
    let skull =
        Core { name: "skull".into(), motion: Motion::Fixed, bind: Some(Bind::Inset(0.03)), mass: None, hinge: None };
    let body = scene::Body {
        name: "head".into(),
        shape: scene::Shape::Soft {
            surface: Some(surface),
            layer: Layer::Cell { cell: settings.cell, grade: 1, thickness: None },
        },
        hulls: None,
        units: None,
        scale: 1.0,
        position: DVec3::ZERO,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        material: Some(material),
        collides: None,
        cores: vec![skull],
        regions: Vec::new(),
        dilatation: Dilatation::Element,
        repair: true,
        joints: Vec::new(),
        supports: Vec::new(),
        loads: Vec::new(),
        reactions: None,
        skeleton: None,
    };
    let tool = Tool::sphere(RADIUS, MASS).at(centre.to_array());
    Scene { tool: Some(tool), ..Scene::of_body("head", body) }
}

/// Opens a simulation of a scene. None of its steps is timed stage by stage, since GPU timestamps take time.
pub fn open(scene: &Scene, settings: &Settings) -> Result<Simulation> {
    let options = Options { device: settings.device.clone(), ..Options::of_program() };
    let mut simulation = Simulation::open(scene, &options)?;
    simulation.time_every(0)?;
    Ok(simulation)
}

/// A body's skin at rest, from which the heights at which the tool touches are computed.
pub struct Skin {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Skin {
    /// Prepares the scene's first body and returns its skin. Errors: there is no body, it cannot be prepared, or it is
    /// not soft.
    pub fn of(scene: &Scene) -> Result<Skin> {
        let missing = || Error::Simulation("the first body of the scene is missing or not soft".into());
        match prepare::body(scene.bodies.first().ok_or_else(missing)?, scene)?.shape {
            Shape::Soft { skin, .. } => Ok(Skin { vertices: skin.vertices, triangles: skin.triangles }),
            _ => Err(missing()),
        }
    }

    /// Position of the tool's centre (m) when the tool, coming down along z at (x, y), first touches the skin, whose
    /// triangles are sampled every [`SAMPLED`]. Errors: no skin lies beneath the tool.
    pub fn touch(&self, [x, y]: [f64; 2]) -> Result<DVec3> {
        let height = |v: DVec3| {
            let beside = (v.x - x).powi(2) + (v.y - y).powi(2);
            (beside < RADIUS * RADIUS).then(|| v.z + (RADIUS * RADIUS - beside).sqrt())
        };
        let z = self.triangles.iter().flat_map(|t| self.samples(t)).filter_map(height).max_by(f64::total_cmp);
        let missing = || Error::Simulation(format!("there is no skin below x = {x} m, y = {y} m"));
        Ok(DVec3::new(x, y, z.ok_or_else(missing)?))
    }

    /// Points of a triangle on a grid along two of its edges, corners included.
    fn samples(&self, triangle: &[u32; 3]) -> impl Iterator<Item = DVec3> {
        let [a, b, c] = triangle.map(|vertex| self.vertices[vertex as usize]);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let count = (longest / SAMPLED).ceil().max(1.0) as usize;
        let share = move |k: usize| k as f64 / count as f64;
        (0..=count).flat_map(move |i| (0..=count - i).map(move |k| a + share(i) * (b - a) + share(k) * (c - a)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_rests_on_what_is_in_its_way() {
        let triangles = vec![[0, 1, 2], [3, 4, 5]];
        let tip = [DVec3::new(0.006, 0.0, 0.005), DVec3::new(0.03, 0.0, -0.1), DVec3::new(0.03, 0.001, -0.1)];
        let flat = [DVec3::new(0.4, -0.1, 0.01), DVec3::new(0.6, -0.1, 0.01), DVec3::new(0.5, 0.2, 0.01)];
        let skin = Skin { vertices: [tip, flat].concat(), triangles };
        assert!((skin.touch([0.0, 0.0]).unwrap() - DVec3::Z * 0.013).length() < 1e-12);
        // In the middle of a large triangle.
        assert!((skin.touch([0.5, 0.0]).unwrap() - DVec3::new(0.5, 0.0, 0.02)).length() < 1e-5);
        assert!(skin.touch([1.0, 0.0]).is_err());
    }
}
