//! The scenes of the solver benchmark: soft bodies (cubic blocks and a human) that hang under gravity, without contact.
//! Each hangs from a fixed rigid core: a rigid body inside the soft body, to which nodes of the layer (the soft body's
//! tetrahedral mesh) are attached.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{self, Body, Shape};
use palpate::scene::{self, Bind, Core, Layer, Material, MaterialLaw, Model, Motion, Surface};
use palpate::{Error, Result, Scene};
use serde::{Deserialize, Serialize};

/// Edge of the cubic blocks, m.
const EDGE: f64 = 0.1;
/// Nodes of a block within this distance of its face x = 0 are attached to the rigid core, m.
const ON_FACE: f64 = 1e-6;
/// Number of vertices of the human's skin (surface mesh).
const HUMAN_VERTICES: usize = 13_000;
/// Edge of a lattice cell of the human's layer, m; this size gives about 10,000 tetrahedra.
const HUMAN_CELL: f64 = 0.0459;
/// Distance from the mean position of the human's nodes up to which nodes are attached to the rigid core, m.
const HUMAN_BOUND: f64 = 0.15;
/// Poisson's ratio of the bodies.
const POISSON: f64 = 0.45;
/// Density of the bodies, kg/m^3.
const DENSITY: f64 = 1000.0;

/// A body with a stiffness, a time step and a number of steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// The body.
    pub mesh: Mesh,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Time step, s.
    pub dt: f64,
    /// Number of steps, from rest.
    pub steps: usize,
}

impl Case {
    /// Name of the case, made of body, stiffness and time step, such as `block10k-20kPa-1ms`.
    pub fn name(&self) -> String {
        format!("{}-{}-{:.0}ms", self.mesh.name(), stiffness(self.young).replace(' ', ""), 1e3 * self.dt)
    }

    /// Stiffness and time step as text for the report.
    pub fn label(&self) -> String {
        format!("{}, {:.0} ms", stiffness(self.young), 1e3 * self.dt)
    }

    /// The scene of this case, with the body at rest. Errors: the body cannot be prepared.
    pub fn scene(&self) -> Result<Scene> {
        self.mesh.scene(self.young, self.dt)
    }
}

/// Young's modulus as text with its unit.
pub fn stiffness(young: f64) -> String {
    if young < 1e6 { format!("{:.0} kPa", 1e-3 * young) } else { format!("{:.0} MPa", 1e-6 * young) }
}

/// The mesh of a body that hangs from its fixed rigid core.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mesh {
    /// A cubic block with this number of cells along an edge, attached at its face x = 0. Each cell is a cube, which is
    /// divided into six tetrahedra (Kuhn's subdivision).
    Block(u32),
    /// A human, attached about the mean position of its nodes.
    Human,
}

impl Mesh {
    /// Short name: for a block it contains the number of tetrahedra in thousands, such as `block10k`; otherwise it is
    /// `human`.
    pub fn name(self) -> String {
        match self {
            Mesh::Block(cells) => format!("block{}k", 6 * u64::from(cells).pow(3) / 1000),
            Mesh::Human => "human".into(),
        }
    }

    /// The scene with the body at rest. `young` is Young's modulus, Pa, and `dt` the time step, s. Errors: the body
    /// cannot be prepared.
    pub fn scene(self, young: f64, dt: f64) -> Result<Scene> {
        let bind = match self {
            Mesh::Block(_) => Bind::Box { low: DVec3::splat(-ON_FACE), high: DVec3::new(ON_FACE, 1.0, 1.0) },
            Mesh::Human => {
                let nodes = layer(&prepared(&self.hanging(young, Vec::new()))?)?.nodes.clone();
                let centre = nodes.iter().sum::<DVec3>() / nodes.len() as f64;
                Bind::Sphere { centre, radius: HUMAN_BOUND }
            }
        };
        let core = Core { name: "core".into(), motion: Motion::Fixed, bind: Some(bind), mass: None, hinge: None };
        let mut scene = self.hanging(young, vec![core]);
        scene.step.dt = dt;
        Ok(scene)
    }

    fn hanging(self, young: f64, cores: Vec<Core>) -> Scene {
        let (surface, layer) = match self {
            Mesh::Block(cells) => (None, Layer::Box { low: DVec3::ZERO, high: DVec3::splat(EDGE), cells: [cells; 3] }),
            Mesh::Human => {
                let surface = Surface::Model { model: Model::Human, vertices: HUMAN_VERTICES };
                (Some(surface), Layer::Cell { cell: HUMAN_CELL, grade: 1, thickness: None })
            }
        };
        let material = Material {
            young,
            poisson: POISSON,
            density: DENSITY,
            damping_mass: 0.0,
            damping_stiffness: 0.0,
            law: MaterialLaw::Corotational,
        };
        let body = scene::Body {
            name: self.name(),
            shape: scene::Shape::Soft { surface, layer },
            // Nothing touches the body, so that one collision proxy (convex hull) is enough.
            hulls: Some(1),
            units: None,
            scale: 1.0,
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: Some(material),
            collides: None,
            cores,
            regions: Vec::new(),
            dilatation: scene::Dilatation::Element,
            repair: true,
            joints: Vec::new(),
            supports: Vec::new(),
            loads: Vec::new(),
            reactions: None,
            skeleton: None,
        };
        Scene::of_body(self.name(), body)
    }
}

/// The first body of a scene, prepared for simulation. Errors: there is no body, or it cannot be prepared.
pub fn prepared(scene: &Scene) -> Result<Body> {
    let body = scene.bodies.first().ok_or_else(|| Error::Simulation("the scene has no body".into()))?;
    prepare::body(body, scene)
}

/// The layer of a soft body. Errors: the body is not soft.
pub fn layer(body: &Body) -> Result<&prepare::Layer> {
    match &body.shape {
        Shape::Soft { layer, .. } => Ok(layer),
        _ => Err(Error::Simulation(format!("the body `{}` is not soft", body.name))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_have_names_and_labels() {
        let case = Case { mesh: Mesh::Block(12), young: 2e6, dt: 0.01, steps: 1 };
        assert_eq!((case.name().as_str(), case.label().as_str()), ("block10k-2MPa-10ms", "2 MPa, 10 ms"));
    }

    #[test]
    fn blocks_are_bound_on_one_face_and_the_human_about_its_middle() {
        let scene = Mesh::Block(4).scene(2e4, 0.01).unwrap();
        assert_eq!(
            (scene.step.dt, Mesh::Block(12).name(), Mesh::Block(26).name()),
            (0.01, "block10k".into(), "block105k".into())
        );
        let body = prepared(&scene).unwrap();
        let block = layer(&body).unwrap();
        assert_eq!((block.tetrahedra.len(), block.nodes.len()), (384, 125));
        assert!(block.nodes.iter().zip(&block.attached).all(|(x, bound)| *bound == (x.x == 0.0)));

        let body = prepared(&Mesh::Human.scene(2e4, 0.01).unwrap()).unwrap();
        let human = layer(&body).unwrap();
        let bound = human.attached.iter().filter(|bound| **bound).count();
        assert!((10_000..11_000).contains(&human.tetrahedra.len()) && bound > 10 && bound < human.nodes.len() / 4);
    }
}
