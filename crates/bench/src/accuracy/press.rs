//! What is pressed: a block with a fixed bottom, and a sphere that a hand pushes into it and holds there.

use glam::{DQuat, DVec3};
use palpate::Scene;
use palpate::scene::{self, Bind, Core, Coupling, Dilatation, Key, Law, Layer, Material, Motion, Tool, ToolShape};

/// Half of the block's edges, m.
pub const HALF: DVec3 = DVec3::new(0.05, 0.03, 0.05);
/// Of the sphere, m.
const RADIUS: f64 = 0.02;
/// Of the sphere, kg.
const MASS: f64 = 0.05;
/// Between sphere and block at the start, m.
const GAP: f64 = 0.0005;
/// Nodes this near the bottom are fixed, of half the height.
const ON_FACE: f64 = 0.03;

/// A press. Lengths, masses and the hand follow `size`; with times that do so too the motions are alike.
#[derive(Debug, Clone, Copy)]
pub struct Press {
    /// Of the block, an edge.
    pub cells: [u32; 3],
    /// Young's modulus, Pa.
    pub young: f64,
    /// Of the block.
    pub law: Law,
    /// Time step, s.
    pub dt: f64,
    /// How far the hand goes down, m.
    pub travel: f64,
    /// In which time, s.
    pub seconds: f64,
    /// Rayleigh damping by stiffness, s.
    pub damping: f64,
    /// Of the hand, N s/m.
    pub hand_damping: f64,
    /// All lengths, of the usual.
    pub size: f64,
    /// Of the world's origin from the block, along x and z, m.
    pub offset: f64,
}

impl Default for Press {
    /// 5 mm in 40 ms, in steps of 1 ms.
    fn default() -> Press {
        Press {
            cells: [7, 4, 7],
            young: 2e4,
            law: Law::Corotational,
            dt: 0.001,
            travel: 0.005,
            seconds: 0.04,
            damping: 0.002,
            hand_damping: 2.0,
            size: 1.0,
            offset: 0.0,
        }
    }
}

impl Press {
    /// The scene.
    pub fn scene(&self) -> Scene {
        let origin = DVec3::new(self.offset, 0.0, self.offset);
        let start = origin + self.size * (HALF.y + RADIUS + GAP) * DVec3::Y;
        let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
        // As the block's own do: masses by the cube of the size, springs by its first power, dampers between them.
        let (mass, size) = (MASS * self.size.powi(3), self.size);
        let tool = Tool {
            shape: ToolShape::Sphere(RADIUS * size),
            mass,
            position: start,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            scale: 1.0,
            repair: true,
        };
        let coupling = Coupling {
            stiffness: 500.0 * size,
            damping: self.hand_damping * size.powi(2),
            angular_stiffness: 0.5 * size.powi(3),
            angular_damping: 0.002 * size.powi(4),
        };
        let mut scene = Scene {
            tool: Some(tool),
            coupling: Some(coupling),
            drive: vec![key(0.0, start), key(self.seconds, start - self.size * self.travel * DVec3::Y)],
            ..Scene::of_body("press", self.block(origin))
        };
        scene.step.dt = self.dt;
        // A block at rest keeps its shape.
        scene.step.gravity = DVec3::ZERO;
        scene.contact.depth_limit = RADIUS * size;
        scene
    }

    fn block(&self, position: DVec3) -> scene::Body {
        let (low, high) = (-self.size * HALF, self.size * HALF);
        let bottom = DVec3::new(2.0 * high.x, low.y + ON_FACE * high.y, 2.0 * high.z);
        let bind = Some(Bind::Box { low: 2.0 * low, high: bottom });
        let material = Material {
            young: self.young,
            poisson: 0.45,
            density: 1000.0,
            damping_mass: 0.0,
            damping_stiffness: self.damping,
            law: self.law,
        };
        scene::Body {
            name: "block".into(),
            shape: scene::Shape::Soft { surface: None, layer: Layer::Box { low, high, cells: self.cells } },
            hulls: None,
            scale: 1.0,
            position,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: Some(material),
            collides: None,
            cores: vec![Core { name: "bottom".into(), motion: Motion::Fixed, bind, mass: None, hinge: None }],
            regions: Vec::new(),
            dilatation: Dilatation::Element,
            repair: true,
            joints: Vec::new(),
            skeleton: None,
        }
    }

    /// Tetrahedra of the block.
    pub fn tetrahedra(&self) -> u32 {
        6 * self.cells.iter().product::<u32>()
    }
}
