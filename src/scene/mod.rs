//! What a user writes: scenes, bodies, materials, meshes in and out. No GPU, no preparation.
//!
//! [`Scene::load`] reads a TOML file (every table is shown in the README) into these plain types, checked: after it,
//! every number is finite and in range, every name resolves. [`SceneBuilder`] makes a scene piece by piece of the same tables, and
//! of meshes in memory. Units are SI; quaternions are x y z w.

mod body;
mod build;
pub(crate) mod check;
mod cursor;
mod drive;
#[doc(hidden)]
pub mod gmsh;
#[doc(hidden)]
pub mod groups;
mod hand;
mod haptics;
mod joint;
mod keys;
mod load;
mod material;
#[doc(hidden)]
pub mod meshes;
mod model;
mod names;
#[doc(hidden)]
pub mod obj;
#[doc(hidden)]
pub mod preset;
#[doc(hidden)]
pub mod profile;
mod skeleton;
#[cfg(test)]
mod tests;
#[doc(hidden)]
pub mod tetgen;
#[doc(hidden)]
pub mod tetrahedra;
mod triangulate;
#[doc(hidden)]
pub mod vtk;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::Result;
pub use body::Dilatation;
#[doc(hidden)]
pub use body::MOST_HULLS;
pub use build::SceneBuilder;
#[doc(hidden)]
pub use check::unit_quaternion;
#[doc(hidden)]
pub use hand::HandParameters;
pub use haptics::{DeviceKind, Haptics, Lowered};
#[doc(hidden)]
pub use haptics::{Dialect, HaplyService};
#[doc(hidden)]
pub use haptics::{NOT_HAPLYS, RATES as HAPTIC_RATES, of_haply};
pub use joint::{Joint, Resistance};
pub use material::{Group, Law, Material, Place, Region};
pub use model::Model;
pub use profile::Profile;
pub use skeleton::{Bone, Skeleton};

/// A whole scene, as written.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The scene file; paths in it are relative to its folder.
    pub file: PathBuf,
    /// Time step and gravity.
    pub step: Step,
    /// Linear solver.
    pub solver: Solver,
    /// Contact law.
    pub contact: Contact,
    /// Bodies, in file order.
    pub bodies: Vec<Body>,
    /// What the device holds, if anything.
    pub tool: Option<Tool>,
    /// Virtual coupling between device and tool; `None`: the tool is not held and moves freely.
    pub coupling: Option<Coupling>,
    /// Pose of the device over time; empty: the device rests at the tool's first pose.
    pub drive: Vec<Key>,
    /// Limits of the haptic device.
    pub haptics: Haptics,
    /// Points to record.
    pub probes: Vec<Probe>,
    /// The preset that it names, and what that decided.
    pub preset: Option<preset::Chosen>,
}

/// `[step]`.
#[derive(Debug, Clone)]
pub struct Step {
    /// Time step, s.
    pub dt: f64,
    /// Acceleration of gravity, m/s^2.
    pub gravity: DVec3,
    /// Newton iterations a step.
    pub newton: u32,
}

/// `[solver]`.
#[derive(Debug, Clone)]
pub struct Solver {
    /// Relative residual to stop at.
    pub tolerance: f64,
    /// Iterations at most.
    pub max_iterations: u32,
    /// Preconditioner.
    pub preconditioner: Preconditioner,
}

/// How the linear system is preconditioned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preconditioner {
    /// The engine chooses.
    Auto,
    /// 3x3 block Jacobi.
    Jacobi,
    /// Block Jacobi and a coarse level.
    Coarse,
}

/// `[contact]`. `None` means "auto".
#[derive(Debug, Clone)]
pub struct Contact {
    /// Penalty stiffness per projected area, N/m^3.
    pub stiffness: Option<f64>,
    /// Penalty damping per projected area, N s/m^3.
    pub damping: Option<f64>,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Speed below which friction is viscous, m/s.
    pub friction_speed: f64,
    /// Edge of the squares in which the depth stage looks for crossings, m; changes its time, not its answer.
    pub texel: Option<f64>,
    /// Depth beyond which a flag is raised, m.
    pub depth_limit: f64,
    /// Path of the depth stage.
    pub depth: Option<DepthPath>,
    /// Whose vertices gather contacts.
    pub sides: Sides,
}

/// Whose vertices gather contacts where two bodies touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// Both skins', each side counting half.
    Both,
    /// Those of the finer skin alone (less area to a vertex), counting whole.
    One,
}

impl Sides {
    /// What a scene may ask for.
    pub const CHOICES: [(&str, Sides); 2] = [("both", Sides::Both), ("one", Sides::One)];
}

/// How triangles find the vertices that they lie over; the answer is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthPath {
    /// The graphics pipeline's rasterizer shares out the work.
    Graphics,
    /// Loops in compute.
    Compute,
}

impl DepthPath {
    /// What a scene or the command line may ask for; `None` chooses by measuring.
    pub const CHOICES: [(&str, Option<DepthPath>); 3] =
        [("auto", None), ("graphics", Some(DepthPath::Graphics)), ("compute", Some(DepthPath::Compute))];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            DepthPath::Graphics => "graphics",
            DepthPath::Compute => "compute",
        }
    }
}

/// `[[body]]`.
#[derive(Debug, Clone)]
pub struct Body {
    /// Unique name.
    pub name: String,
    /// What it is made of.
    pub shape: Shape,
    /// Proxies at most; `None`: the usual number.
    pub hulls: Option<u32>,
    /// Uniform scale of file coordinates.
    pub scale: f64,
    /// World position of the file's origin, m.
    pub position: DVec3,
    /// World orientation.
    pub orientation: DQuat,
    /// Initial velocity, world, m/s.
    pub velocity: DVec3,
    /// Elastic material; `None` for rigid bodies.
    pub material: Option<Material>,
    /// Over what the volumetric strain of a soft body is one.
    pub dilatation: Dilatation,
    /// Where the material is another; of a soft body.
    pub regions: Vec<Region>,
    /// Names of bodies it collides with ("tool" is the tool); `None`: every other.
    pub collides: Option<Vec<String>>,
    /// Rigid cores; first one a bone where there is a skeleton, in its order.
    pub cores: Vec<Core>,
    /// What joins cores to each other.
    pub joints: Vec<Joint>,
    /// Whether the surface's file is repaired where it needs it; else it is refused.
    pub repair: bool,
    /// Bones, and how they hang together.
    pub skeleton: Option<Skeleton>,
}

impl Body {
    /// A body of a shape at the origin, as a scene file without any other key gives it.
    fn of(name: &str, shape: Shape, material: Option<Material>, cores: Vec<Core>) -> Body {
        Body {
            name: name.into(),
            shape,
            hulls: None,
            scale: 1.0,
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material,
            dilatation: Dilatation::default(),
            regions: Vec::new(),
            collides: None,
            cores,
            joints: Vec::new(),
            repair: true,
            skeleton: None,
        }
    }

    /// A soft body that fills a skin, with nothing bound: add cores to hold it.
    pub fn soft(name: &str, surface: Surface, layer: Layer, material: Material) -> Body {
        Body::of(name, Shape::Soft { surface: Some(surface), layer }, Some(material), Vec::new())
    }

    /// A soft box of cells, `low` and `high` its corners (m), whose boundary is its skin.
    pub fn block(name: &str, low: [f64; 3], high: [f64; 3], cells: [u32; 3], material: Material) -> Body {
        let layer = Layer::Box { low: low.into(), high: high.into(), cells };
        Body::of(name, Shape::Soft { surface: None, layer }, Some(material), Vec::new())
    }

    /// A rigid body, with the mass (kg) that a dynamic one needs.
    pub fn rigid(name: &str, surface: Surface, motion: Motion, mass: Option<f64>) -> Body {
        let core = Core { name: name.into(), motion, bind: None, mass, hinge: None };
        Body::of(name, Shape::Rigid { surface }, None, vec![core])
    }

    /// A fixed half-space below the plane `normal . x = offset` (m); `normal` of any length but zero.
    pub fn plane(name: &str, normal: [f64; 3], offset: f64) -> Body {
        let (normal, length) = (DVec3::from(normal), DVec3::from(normal).length());
        Body::of(name, Shape::Plane { normal: normal / length, offset: offset / length }, None, Vec::new())
    }

    /// Moves the mesh's origin to a place, world, m.
    pub fn at(self, position: [f64; 3]) -> Body {
        Body { position: position.into(), ..self }
    }
}

/// What a body is made of.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Soft: a tetrahedral layer, and a skin; without a skin the layer's boundary is the skin.
    Soft {
        /// Skin.
        surface: Option<Surface>,
        /// Layer.
        layer: Layer,
    },
    /// Rigid: a skin only. Its body has exactly one core, without `bind`, that says how it moves.
    Rigid {
        /// Skin.
        surface: Surface,
    },
    /// Rigid half-space `normal . x <= offset`, fixed.
    Plane {
        /// Unit outward normal.
        normal: DVec3,
        /// Offset, m.
        offset: f64,
    },
}

/// Where a skin comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Surface {
    /// An OBJ file.
    File(PathBuf),
    /// A model that the engine makes by itself.
    Model {
        /// Which.
        model: Model,
        /// Number of skin vertices, within [`Model::vertices`].
        vertices: usize,
    },
    /// Handed over in memory: [`Surface::of_triangles`].
    #[doc(hidden)]
    Mesh(Arc<obj::TriangleMesh>),
}

impl Surface {
    /// A surface in memory, of vertices (m, before the body's scale) and triangles, counter-clockwise seen from outside: what an
    /// OBJ file of them would be.
    ///
    /// # Errors
    /// A coordinate is not finite, a triangle names a vertex that is not there, or there is nothing of any area.
    pub fn of_triangles(vertices: Vec<DVec3>, triangles: &[[u32; 3]]) -> Result<Surface> {
        meshes::surface("in memory", vertices, triangles).map(|mesh| Surface::Mesh(Arc::new(mesh)))
    }
}

/// Where the layer comes from.
#[derive(Debug, Clone)]
pub enum Layer {
    /// Made to fill the surface, from lattice cells.
    Cell {
        /// Edge of the cells (file coordinates, before scale).
        cell: f64,
        /// Largest cell deep inside, as a multiple of `cell`: 1 (all equal), 2, 4 or 8.
        grade: u32,
        /// Depth of the shell that is filled, m in file coordinates; `None`: everything.
        thickness: Option<f64>,
    },
    /// Made to fill the surface, with so many lattice cells along its largest extent.
    Across {
        /// Cells along the largest extent.
        cells: u32,
        /// Largest cell deep inside, as a multiple of those at the surface: 1 (all equal), 2, 4 or 8.
        grade: u32,
        /// Depth of the shell that is filled, m in file coordinates; `None`: everything.
        thickness: Option<f64>,
    },
    /// A tetrahedral mesh file.
    File(PathBuf),
    /// Handed over in memory: [`Layer::of_tetrahedra`].
    #[doc(hidden)]
    Mesh(Arc<tetrahedra::TetMesh>),
    /// A box of Kuhn cells, each cut along (0,0,0)-(1,1,1).
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
        /// Cells per axis.
        cells: [u32; 3],
    },
}

impl Layer {
    /// A layer in memory, of nodes (m, before the body's scale) and tetrahedra: what a mesh file of them would be. Those that are
    /// inside out are turned.
    ///
    /// # Errors
    /// A coordinate is not finite, a tetrahedron names a node that is not there, has no volume or is given twice.
    pub fn of_tetrahedra(nodes: Vec<DVec3>, tetrahedra: &[[u32; 4]]) -> Result<Layer> {
        meshes::layer("in memory", nodes, tetrahedra).map(|mesh| Layer::Mesh(Arc::new(mesh)))
    }
}

/// `[[body.core]]`.
#[derive(Debug, Clone)]
pub struct Core {
    /// Name, unique in its body.
    pub name: String,
    /// How it moves.
    pub motion: Motion,
    /// Which nodes it carries; `None` for the core of a rigid body.
    pub bind: Option<Bind>,
    /// Mass, kg, of a dynamic core; `None`: from the bound region.
    pub mass: Option<f64>,
    /// All that a dynamic core may turn about; `None`: it moves freely.
    pub hinge: Option<Hinge>,
}

impl Core {
    fn of(name: &str, motion: Motion, bind: Bind) -> Core {
        Core { name: name.into(), motion, bind: Some(bind), mass: None, hinge: None }
    }

    /// A core that does not move.
    pub fn fixed(name: &str, bind: Bind) -> Core {
        Core::of(name, Motion::Fixed, bind)
    }

    /// A core that follows keys.
    pub fn driven(name: &str, bind: Bind, keys: Vec<Key>) -> Core {
        Core::of(name, Motion::Driven(keys), bind)
    }

    /// A core that moves by forces, with the mass of what it binds.
    pub fn dynamic(name: &str, bind: Bind) -> Core {
        Core::of(name, Motion::Dynamic, bind)
    }
}

/// A line, fixed in the world and in the core, in file coordinates, before scale and pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hinge {
    /// A point on it.
    pub point: DVec3,
    /// Along it, unit.
    pub axis: DVec3,
}

/// How a core moves.
#[derive(Debug, Clone)]
pub enum Motion {
    /// Not at all.
    Fixed,
    /// Along keys (time, centre, orientation; world).
    Driven(Vec<Key>),
    /// By forces.
    Dynamic,
}

/// Which nodes a core carries; regions in file coordinates, before scale and pose.
#[derive(Debug, Clone)]
pub enum Bind {
    /// Nodes at least this deep below the skin, m in file coordinates.
    Inset(f64),
    /// Nodes in a box.
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
    },
    /// Nodes in a sphere.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius.
        radius: f64,
    },
    /// Nodes in a capsule: a bone. Where capsules overlap the nearest bone has the node (see
    /// [`crate::prepare::bind::nearer_bones`]).
    Capsule(Capsule),
    /// These nodes, zero-based in file order.
    Nodes(Vec<u32>),
    /// Every node.
    All,
}

/// A rod with round ends whose radius runs evenly from one end to the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// Middles of the two ends; they may coincide.
    pub ends: [DVec3; 2],
    /// Radius at each end.
    pub radii: [f64; 2],
}

/// A pose at a time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Time, s.
    pub time: f64,
    /// Position, m.
    pub position: DVec3,
    /// Orientation.
    pub orientation: DQuat,
}

impl Key {
    /// A key at a time (s) and a position (m), with the identity as orientation.
    pub fn at(time: f64, position: [f64; 3]) -> Key {
        Key { time, position: position.into(), orientation: DQuat::IDENTITY }
    }
}

/// `[tool]`.
#[derive(Debug, Clone)]
pub struct Tool {
    /// Its shape.
    pub shape: ToolShape,
    /// Mass, kg.
    pub mass: f64,
    /// World position of its centre at the start, m.
    pub position: DVec3,
    /// World orientation at the start.
    pub orientation: DQuat,
    /// Initial velocity, world, m/s.
    pub velocity: DVec3,
    /// Uniform scale of file coordinates.
    pub scale: f64,
    /// Whether the surface's file is repaired where it needs it; else it is refused.
    pub repair: bool,
}

impl Tool {
    fn of(shape: ToolShape, mass: f64) -> Tool {
        let (position, orientation, velocity) = (DVec3::ZERO, DQuat::IDENTITY, DVec3::ZERO);
        Tool { shape, mass, position, orientation, velocity, scale: 1.0, repair: true }
    }

    /// A sphere of a radius (m) and a mass (kg), at the origin.
    pub fn sphere(radius: f64, mass: f64) -> Tool {
        Tool::of(ToolShape::Sphere(radius), mass)
    }

    /// A closed surface of a mass (kg), at the origin.
    pub fn surface(surface: Surface, mass: f64) -> Tool {
        Tool::of(ToolShape::Surface(surface), mass)
    }

    /// A body of the scene, held by its first core, which is dynamic.
    pub fn body(name: &str) -> Tool {
        Tool::of(ToolShape::Body(name.into()), 0.0)
    }

    /// Moves the tool to another place, world, m.
    pub fn at(self, position: [f64; 3]) -> Tool {
        Tool { position: position.into(), ..self }
    }
}

/// Shape of the tool.
#[derive(Debug, Clone)]
pub enum ToolShape {
    /// A sphere of this radius, m.
    Sphere(f64),
    /// A closed surface.
    Surface(Surface),
    /// A body of the scene, held by its first core, which is dynamic.
    Body(String),
}

/// `[coupling]`: the virtual coupling between device and tool (Colgate et al. 1995).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Coupling {
    /// How the force answers to the distance between device and tool, N/m.
    pub stiffness: f64,
    /// How the force answers to the difference of their velocities, N s/m.
    pub damping: f64,
    /// How the torque answers to the angle between them, N m/rad.
    pub angular_stiffness: f64,
    /// How the torque answers to the difference of their angular velocities, N m s/rad.
    pub angular_damping: f64,
}

/// `[[probe]]`: a skin vertex to follow.
#[derive(Debug, Clone)]
pub struct Probe {
    /// Column prefix in the trace.
    pub name: String,
    /// Body it sits on.
    pub body: String,
    /// The skin vertex nearest to this point is followed (file coordinates, before scale and pose).
    pub nearest: DVec3,
}
