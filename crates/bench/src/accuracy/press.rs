//! A press: a scene that several accuracy curves (error and computing time of the settings of one varied value)
//! measure. It has a block with a fixed bottom, and a sphere as the tool. The haptic device leads the tool by the
//! virtual coupling, a spring and damper; the device pushes the tool into the block and then holds it there.

use glam::{DQuat, DVec3};
use palpate::Scene;
use palpate::scene::{self, Bind, Core, Coupling, Dilatation, Key, Layer, Material, MaterialLaw, Motion, Tool};

/// Half extents of the block, m.
pub const HALF: DVec3 = DVec3::new(0.05, 0.03, 0.05);
/// Radius of the sphere, m.
const RADIUS: f64 = 0.02;
/// Mass of the sphere, kg.
const MASS: f64 = 0.05;
/// Gap between sphere and block at the start, m.
const GAP: f64 = 0.0005;
/// Nodes at the block's bottom are attached to a fixed rigid core (rigid body inside the soft one): those whose height
/// above the bottom is below this share of half the block's height.
const ON_FACE: f64 = 0.03;

/// A press of a sphere into a block. The scene scales lengths, masses and coupling gains by `size`; if the caller
/// scales `dt`, `seconds` and `damping` by the size too, the motions at different sizes are similar.
#[derive(Debug, Clone, Copy)]
pub struct Press {
    /// Cells of the block along x, y and z.
    pub cells: [u32; 3],
    /// Young's modulus, Pa.
    pub young: f64,
    /// Material law of the block.
    pub law: MaterialLaw,
    /// Time step, s.
    pub dt: f64,
    /// Distance by which the haptic device goes down, m, where `size` is 1.
    pub travel: f64,
    /// Time in which the device goes down, s; after it the device stays.
    pub seconds: f64,
    /// Stiffness-proportional Rayleigh damping, s.
    pub damping: f64,
    /// Damping of the virtual coupling, N s/m, where `size` is 1.
    pub hand_damping: f64,
    /// Factor on all lengths.
    pub size: f64,
    /// Offset of the block from the world's origin, the same along x and z, m.
    pub offset: f64,
}

impl Default for Press {
    /// The haptic device goes down by 5 mm in 40 ms, in steps of 1 ms.
    fn default() -> Press {
        Press {
            cells: [7, 4, 7],
            young: 2e4,
            law: MaterialLaw::Corotational,
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
    /// The scene of this press.
    pub fn scene(&self) -> Scene {
        let origin = DVec3::new(self.offset, 0.0, self.offset);
        let start = origin + self.size * (HALF.y + RADIUS + GAP) * DVec3::Y;
        let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
        // Motions at different sizes are similar if times scale with the size, the mass with its cube, the stiffness of
        // the coupling with the size and its damping with the square of the size; angular gains have two more powers of
        // the size.
        let (mass, size) = (MASS * self.size.powi(3), self.size);
        let tool = Tool::sphere(RADIUS * size, mass).at(start.to_array());
        let coupling = Coupling {
            stiffness: 500.0 * size,
            damping: self.hand_damping * size.powi(2),
            angular_stiffness: 0.5 * size.powi(3),
            angular_damping: 0.002 * size.powi(4),
        };
        let mut scene = Scene {
            tool: Some(tool),
            coupling: Some(coupling),
            trajectory: vec![key(0.0, start), key(self.seconds, start - self.size * self.travel * DVec3::Y)],
            ..Scene::of_body("press", self.block(origin))
        };
        scene.step.dt = self.dt;
        // Without gravity, so that the block keeps its shape at rest.
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
            units: None,
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
            supports: Vec::new(),
            loads: Vec::new(),
            reactions: None,
            skeleton: None,
        }
    }

    /// Number of tetrahedra of the block.
    pub fn tetrahedra(&self) -> u32 {
        6 * self.cells.iter().product::<u32>()
    }
}
