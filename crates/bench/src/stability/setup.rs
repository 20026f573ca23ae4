//! Scenes of the stability matrix (many stiff and extreme simulations, each judged by invariants): a block that is
//! attached at a face, floats freely or stands on a floor, and in some scenes a sphere. The sphere is the tool, the
//! rigid body that the haptic device leads by a virtual coupling (spring and damper). Some lengths are given in block
//! edges, that is as multiples of the length of the block's edge.

use std::path::PathBuf;

use glam::{DQuat, DVec3};
use palpate::Scene;
use palpate::scene::preset::Preset;
use palpate::scene::{
    Bind, Body, Core, Coupling, Dilatation, Key, Layer, Material, MaterialLaw, Motion, Region, Shape, Support, Surface,
    Tool, ToolShape,
};

/// A node lies on a face of the block if its distance from the face is at most this share of the block's edge.
const ON_FACE: f64 = 1e-6;
/// Radius of the sphere, in block edges.
pub const RADIUS: f64 = 0.2;
/// Gap between sphere and block at the start, in block edges, if the haptic device has no path.
const GAP: f64 = 0.02;

/// What holds the block: mostly nodes that are attached to a fixed rigid core (rigid body inside the block, which holds
/// these nodes in place).
#[derive(Debug, Clone, PartialEq)]
pub enum Attachment {
    /// The face x = 0, from which the block hangs out sideways.
    Side,
    /// The face y = 0, on which the block stands.
    Bottom,
    /// All nodes below a quarter of the edge.
    LowestQuarter,
    /// The nodes within a sixth of the edge of the line through the block's centre along x.
    Bone,
    /// Rollers on the faces x = 0, y = 0 and z = 0, in place of a core.
    Rollers,
    /// No nodes.
    Nothing,
    /// All nodes.
    All,
    /// All nodes but the last.
    AllButOne,
}

/// Path of the haptic device: times (s), and heights (m) above the position of the sphere's centre at which the sphere
/// touches the top of the undeformed block.
pub type Way = Vec<(f64, f64)>;

/// The sphere, which is the tool.
#[derive(Debug, Clone, PartialEq)]
pub struct Sphere {
    /// Mass, kg.
    pub mass: f64,
    /// Stiffness (N/m) and damping (N s/m) of the sphere's virtual coupling; `None`: the sphere moves freely.
    pub coupling: Option<(f64, f64)>,
    /// Downward speed at the start, m/s.
    pub speed: f64,
    /// Path of the haptic device.
    pub path: Way,
}

/// Parameters of a scene of the matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Edge of the block, m.
    pub edge: f64,
    /// Number of cells along the edge.
    pub cells: u32,
    /// Mesh file of the body; `None`: the body is a cube with `cells` cells along each edge.
    pub mesh: Option<PathBuf>,
    /// Material of the whole block.
    pub material: Material,
    /// Time step, s.
    pub dt: f64,
    /// Gravity, downward, m/s^2.
    pub gravity: f64,
    /// Position of the block's corner with the least coordinates, m.
    pub origin: DVec3,
    /// Which nodes are attached.
    pub attachment: Attachment,
    /// The sphere tool; `None`: there is none.
    pub sphere: Option<Sphere>,
    /// Whether there is a floor at the block's bottom.
    pub has_floor: bool,
    /// Contact stiffness, N/m^3; `None`: the engine chooses it.
    pub stiffness: Option<f64>,
    /// Preset whose settings the scene has, apart from the time step, which is `dt`; `None`: the engine's defaults.
    pub preset: Option<Preset>,
    /// Newton iterations of a step, where there is no preset.
    pub newton: u32,
    /// Parts of another material.
    pub regions: Vec<Region>,
    /// Whether an equal block, not attached, lies on the block; the sphere then touches that one.
    pub is_stacked: bool,
    /// Mesh file of a tool that takes the place of the sphere; its lowest point is as far below its centre as the
    /// sphere's.
    pub tool: Option<PathBuf>,
}

impl Default for Setup {
    fn default() -> Setup {
        let material = Material {
            law: MaterialLaw::Corotational,
            young: 2e4,
            poisson: 0.4,
            density: 1000.0,
            damping_mass: 0.0,
            damping_stiffness: 0.0,
        };
        Setup {
            edge: 0.1,
            cells: 3,
            mesh: None,
            material,
            dt: 1e-3,
            gravity: 9.81,
            origin: DVec3::ZERO,
            attachment: Attachment::Side,
            sphere: None,
            has_floor: false,
            stiffness: None,
            preset: None,
            newton: 1,
            regions: Vec::new(),
            is_stacked: false,
            tool: None,
        }
    }
}

impl Setup {
    /// Angular frequency of the slowest longitudinal vibration of the block, attached at one face, rad/s. The block's
    /// bending vibration is slower, at less than half of this frequency.
    pub fn frequency(&self) -> f64 {
        0.5 * std::f64::consts::PI * (self.material.young / self.material.density).sqrt() / self.edge
    }

    /// The setup with mass-proportional damping by which the block soon comes to rest: close to critical for its
    /// slowest mode.
    pub fn damped(mut self) -> Setup {
        let rate = self.frequency();
        self.change_materials(|material| material.damping_mass = rate);
        self
    }

    /// Changes the material of the block and those of its parts.
    pub fn change_materials(&mut self, change: impl Fn(&mut Material)) {
        change(&mut self.material);
        self.regions.iter_mut().for_each(|region| change(&mut region.material));
    }

    /// Position of the sphere's centre at which the sphere touches the top of the undeformed block, m.
    pub fn touching(&self) -> DVec3 {
        let top = if self.is_stacked { 2.0 } else { 1.0 };
        self.origin + self.edge * DVec3::new(0.5, top + RADIUS, 0.5)
    }

    /// The scene with these parameters and this name.
    pub fn scene(&self, name: &str) -> Scene {
        let mut scene = Scene::of_body(name, self.body());
        scene.step.dt = self.dt;
        scene.step.newton = self.newton;
        scene.step.gravity = DVec3::new(0.0, -self.gravity, 0.0);
        scene.contact.stiffness = self.stiffness;
        if let Some(preset) = self.preset {
            (scene.solver.tolerance, scene.solver.max_iterations) = (preset.tolerance, preset.max_iterations);
            (scene.step.newton, scene.contact.sides) = (preset.newton, preset.sides);
        }
        scene.contact.depth_limit *= self.edge / Setup::default().edge;
        if self.is_stacked {
            let position = self.origin + self.edge * DVec3::Y;
            scene.bodies.push(Body { name: "upper".into(), position, cores: Vec::new(), ..self.body() });
        }
        if self.has_floor {
            let shape = Shape::Plane { normal: DVec3::Y, offset: self.origin.y };
            scene.bodies.push(Body { name: "floor".into(), shape, material: None, cores: Vec::new(), ..self.body() });
        }
        if let Some(sphere) = &self.sphere {
            self.add_sphere(&mut scene, sphere);
        }
        scene
    }

    fn add_sphere(&self, scene: &mut Scene, sphere: &Sphere) {
        let at = |height: f64| self.touching() + height * DVec3::Y;
        let shape = match &self.tool {
            None => ToolShape::Sphere(RADIUS * self.edge),
            Some(file) => ToolShape::Surface(Surface::File(file.clone())),
        };
        let start = sphere.path.first().map_or(GAP * self.edge, |(_, height)| *height);
        let resting = Tool { shape, ..Tool::sphere(RADIUS * self.edge, sphere.mass).at(at(start).to_array()) };
        scene.tool = Some(Tool { velocity: -sphere.speed * DVec3::Y, ..resting });
        let key =
            |(time, height): &(f64, f64)| Key { time: *time, position: at(*height), orientation: DQuat::IDENTITY };
        scene.trajectory = sphere.path.iter().map(key).collect();
        // Angular stiffness and damping are the linear ones times the square of a lever arm, which is the sphere's
        // radius.
        let arm2 = (RADIUS * self.edge).powi(2);
        scene.coupling = sphere.coupling.map(|(stiffness, damping)| Coupling {
            stiffness,
            damping,
            angular_stiffness: stiffness * arm2,
            angular_damping: damping * arm2,
        });
    }

    fn body(&self) -> Body {
        let layer = match &self.mesh {
            Some(file) => Layer::File(file.clone()),
            None => Layer::Box { low: DVec3::ZERO, high: DVec3::splat(self.edge), cells: [self.cells; 3] },
        };
        Body {
            name: "block".into(),
            shape: Shape::Soft { surface: None, layer },
            hulls: Some(1),
            units: None,
            scale: 1.0,
            position: self.origin,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: Some(self.material),
            collides: None,
            cores: self.bind().into_iter().map(core).collect(),
            regions: self.regions.clone(),
            dilatation: Dilatation::Element,
            repair: true,
            joints: Vec::new(),
            supports: if self.attachment == Attachment::Rollers { self.rollers() } else { Vec::new() },
            loads: Vec::new(),
            reactions: None,
            skeleton: None,
        }
    }

    fn rollers(&self) -> Vec<Support> {
        let (thin, wide) = (ON_FACE * self.edge, DVec3::splat(2.0 * self.edge));
        let roller = |(name, normal): (&str, DVec3)| {
            let bind = Bind::Box { low: -wide, high: wide - normal * (wide - thin) };
            Support::plane(name, normal.to_array(), bind)
        };
        ["x", "y", "z"].into_iter().zip(DVec3::AXES).map(roller).collect()
    }

    fn bind(&self) -> Option<Bind> {
        let (thin, wide) = (ON_FACE * self.edge, 2.0 * self.edge);
        match self.attachment {
            Attachment::Side => {
                Some(Bind::Box { low: -DVec3::new(thin, wide, wide), high: DVec3::new(thin, wide, wide) })
            }
            Attachment::Bottom => {
                Some(Bind::Box { low: -DVec3::new(wide, thin, wide), high: DVec3::new(wide, thin, wide) })
            }
            Attachment::LowestQuarter => {
                let high = DVec3::new(wide, 0.25 * self.edge, wide);
                Some(Bind::Box { low: -DVec3::splat(wide), high })
            }
            Attachment::Bone => {
                let (middle, near) = (0.5 * self.edge, self.edge / 6.0);
                let low = DVec3::new(-wide, middle - near, middle - near);
                Some(Bind::Box { low, high: DVec3::new(wide, middle + near, middle + near) })
            }
            Attachment::Rollers | Attachment::Nothing => None,
            Attachment::All => Some(Bind::All),
            Attachment::AllButOne => Some(Bind::Nodes((0..(self.cells + 1).pow(3) - 1).collect())),
        }
    }
}

fn core(bind: Bind) -> Core {
    Core { name: "held".into(), motion: Motion::Fixed, bind: Some(bind), mass: None, hinge: None }
}
