//! The scene of the accuracy curves about resolution in space. A ball is the tool: the haptic device leads it by the
//! virtual coupling, a stiff spring and damper. The body is placed so that the ball touches it at the origin; a head is
//! touched at a point of its cheek instead. The ball is pushed into the body along -y (into a head along -z) and held
//! there until everything is at rest.

use std::path::PathBuf;

use glam::{DQuat, DVec3};
use palpate::Scene;
use palpate::scene::{
    self, Bind, Core, Coupling, Dilatation, Key, Layer, Material, MaterialLaw, Model, Motion, Sides, Surface, Tool,
    ToolShape,
};

/// Time step, s; long, since only the state at rest counts.
const DT: f64 = 0.02;
/// Number of steps in which the ball goes down.
const DOWN: usize = 12;
/// Number of steps in which the ball is then held at its full depth.
const HELD: usize = 10;
/// Number of steps of a press.
pub const STEPS: usize = DOWN + HELD;
/// Height of the blocks, and radius of the domes, m.
pub const HEIGHT: f64 = 0.04;
/// Half the width of blocks, m.
pub const HALF_WIDTH: f64 = 0.06;
/// Gap between ball and body at the start, as a share of the press depth.
const GAP: f64 = 0.1;
/// Nodes within this distance of the base are attached to a fixed rigid core (rigid body inside the soft one), m.
const ON_BASE: f64 = 1e-4;
/// Point of the head near which a ball that comes along -z first touches the head, m.
const CHEEK: DVec3 = DVec3::new(0.03, -0.02, 0.08);
/// Young's modulus of the body, Pa.
pub const YOUNG: f64 = 2e4;
/// Mass of the ball, kg.
const MASS: f64 = 0.05;

/// Contact stiffness unless a curve sets another, N/m^3.
pub const STIFFNESS: f64 = 2e7;

/// A press of a ball into a body.
#[derive(Debug, Clone)]
pub struct Press {
    /// The body that is pressed.
    pub body: Body,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Whether the volumetric strain is averaged over patches of elements (F-bar) against locking.
    pub dilatation: Dilatation,
    /// Radius of the ball, m.
    pub radius: f64,
    /// File of a mesh of the ball; `None`: the engine's own sphere mesh.
    pub ball: Option<PathBuf>,
    /// How deep the ball goes beyond the first touch, m.
    pub depth: f64,
    /// Contact stiffness, N/m^3; `None`: the engine chooses it.
    pub stiffness: Option<f64>,
    /// Whether the vertices of both skins (surface meshes) are tested for contact, or those of the finer skin alone.
    pub sides: Sides,
    /// Relative residual at which the solver stops.
    pub tolerance: f64,
}

/// A body that is pressed.
#[derive(Debug, Clone)]
pub enum Body {
    /// A body whose base, [`HEIGHT`] below the origin, is attached to a fixed rigid core: its skin, or surface mesh
    /// (`None`: the layer's boundary), and its layer, or tetrahedral mesh.
    Based(Option<Surface>, Layer),
    /// The generated head, pressed in its cheek: number of skin vertices, and largest number of collision proxies
    /// (convex hulls that select which parts may touch).
    Head(usize, Option<u32>),
}

impl Press {
    /// A press of a ball of 6 cm radius to a depth of 3 mm.
    pub fn new(body: Body) -> Press {
        Press {
            body,
            poisson: 0.45,
            dilatation: Dilatation::Element,
            radius: 0.06,
            ball: None,
            depth: 0.003,
            stiffness: Some(STIFFNESS),
            sides: Sides::Both,
            tolerance: 1e-6,
        }
    }

    /// Centre of the ball at its full depth, m, and the body's outward direction, opposite to which the ball is pushed.
    pub fn pressed(&self) -> (DVec3, DVec3) {
        let (touch, outward) = self.touch();
        (touch + (self.radius - self.depth) * outward, outward)
    }

    fn touch(&self) -> (DVec3, DVec3) {
        match self.body {
            Body::Based(..) => (DVec3::ZERO, DVec3::Y),
            Body::Head(..) => (CHEEK, DVec3::Z),
        }
    }

    /// The scene of this press.
    pub fn scene(&self) -> Scene {
        let (touch, outward) = self.touch();
        let centre = |out: f64| touch + (self.radius + out) * outward;
        let start = centre(GAP * self.depth);
        let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
        let tool = Tool {
            shape: self
                .ball
                .clone()
                .map_or(ToolShape::Sphere(self.radius), |file| ToolShape::Surface(Surface::File(file))),
            ..Tool::sphere(self.radius, MASS).at(start.to_array())
        };
        // The coupling is so stiff that the ball stays within a few micrometres of the position that the haptic device
        // demands.
        let coupling = Coupling { stiffness: 1e6, damping: 2e3, angular_stiffness: 50.0, angular_damping: 1.0 };
        let mut scene = Scene {
            tool: Some(tool),
            coupling: Some(coupling),
            trajectory: vec![key(0.0, start), key(DOWN as f64 * DT, centre(-self.depth))],
            ..Scene::of_body("press", self.body())
        };
        scene.step.dt = DT;
        // Without gravity, so that the body keeps its shape at rest.
        scene.step.gravity = DVec3::ZERO;
        scene.contact.stiffness = self.stiffness;
        scene.contact.sides = self.sides;
        scene.contact.depth_limit = 0.02;
        scene.solver.tolerance = Some(self.tolerance);
        scene.solver.max_iterations = 1000;
        scene
    }

    fn body(&self) -> scene::Body {
        let (surface, layer, hulls, bind) = match &self.body {
            Body::Based(surface, layer) => {
                let high = DVec3::new(1.0, -HEIGHT + ON_BASE, 1.0);
                (surface.clone(), layer.clone(), None, Bind::Box { low: -DVec3::ONE, high })
            }
            Body::Head(vertices, hulls) => {
                let surface = Surface::Model { model: Model::Head, vertices: *vertices };
                let layer = Layer::Cell { cell: 0.03, grade: 1, thickness: None };
                (Some(surface), layer, *hulls, Bind::Inset(0.03))
            }
        };
        let material = Material {
            young: YOUNG,
            poisson: self.poisson,
            density: 1000.0,
            damping_mass: 0.0,
            damping_stiffness: 0.0,
            law: MaterialLaw::Corotational,
        };
        scene::Body {
            name: "body".into(),
            shape: scene::Shape::Soft { surface, layer },
            hulls,
            units: None,
            scale: 1.0,
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: Some(material),
            collides: None,
            cores: vec![Core { name: "base".into(), motion: Motion::Fixed, bind: Some(bind), mass: None, hinge: None }],
            regions: Vec::new(),
            dilatation: self.dilatation,
            repair: true,
            joints: Vec::new(),
            supports: Vec::new(),
            loads: Vec::new(),
            reactions: None,
            skeleton: None,
        }
    }
}
