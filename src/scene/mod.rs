//! The scene as a user describes it: bodies, materials, tool and settings, and readers and writers of meshes. This
//! module has neither GPU code nor the preparation of meshes.
//!
//! [`Scene::load`] reads a TOML file (docs/reference/scene.md lists every table) into plain types and checks it: every
//! number is finite and in range, and every name refers to something that exists. [`SceneBuilder`] makes a scene piece
//! by piece, from Rust values, from TOML tables or from meshes in memory. Units are SI; quaternions are x y z w.
//!
//! A soft body is layered: its skin (a fine triangle surface) is embedded in its layer (the tetrahedral mesh that is
//! simulated), and nodes of the layer may be attached to cores (rigid bodies inside the soft one). The tool is the
//! rigid body that the haptic device moves, through a virtual coupling (spring and damper). The trace is a CSV file
//! with the results of a run. "File coordinates" are those of a body's mesh file, before scale and pose.

mod body;
mod build;
pub(crate) mod check;
mod cursor;
#[doc(hidden)]
pub mod dotted;
mod gltf;
#[doc(hidden)]
pub mod gmsh;
#[doc(hidden)]
pub mod groups;
mod hand;
mod haptics;
mod joint;
mod keys;
mod load;
mod loads;
mod material;
#[doc(hidden)]
pub mod meshes;
mod model;
mod names;
mod number;
#[doc(hidden)]
pub mod obj;
mod ply;
#[doc(hidden)]
pub mod preset;
#[doc(hidden)]
pub mod profile;
#[doc(hidden)]
pub mod reference;
mod skeleton;
mod stl;
mod support;
#[cfg(test)]
mod tests;
#[doc(hidden)]
pub mod tetgen;
#[doc(hidden)]
pub mod tetrahedra;
mod tools;
mod trajectory;
#[doc(hidden)]
pub mod triangles;
mod triangulate;
#[doc(hidden)]
pub mod units;
#[doc(hidden)]
pub mod vtk;
#[doc(hidden)]
pub mod vtk_xml;

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
#[doc(hidden)]
pub use haptics::RATES as HAPTIC_RATES;
pub use haptics::{DeviceKind, Haptics, Lowered};
#[doc(hidden)]
pub use haptics::{Dialect, HaplyService};
pub use joint::{Joint, Resistance};
pub use loads::Load;
#[doc(hidden)]
pub use loads::LoadKind;
pub use material::{Group, Material, MaterialLaw, Place, Region};
pub use model::Model;
pub use profile::Profile;
pub use skeleton::{Bone, Skeleton};
#[doc(hidden)]
pub use support::Constraint;
pub use support::Support;
#[doc(hidden)]
pub use tools::Leader;

/// A whole scene.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The scene file; paths in the scene are relative to its folder.
    pub file: PathBuf,
    /// Time step, gravity and number of Newton iterations.
    pub step: Step,
    /// Settings of the linear solver.
    pub solver: Solver,
    /// Settings of contact.
    pub contact: Contact,
    /// Bodies, in the order of the scene file.
    pub bodies: Vec<Body>,
    /// The tool, which the haptic device moves, if there is one; of several tools the first.
    pub tool: Option<Tool>,
    /// The tools after the first. In a scene that has any, each tool is a body of the scene.
    pub further_tools: Vec<FurtherTool>,
    /// Virtual coupling between haptic device and tool; `None`: nothing holds the tool, which moves freely.
    pub coupling: Option<Coupling>,
    /// Reference trajectory of the haptic device: its pose at given times. If empty, the device rests at the tool's
    /// first pose.
    pub trajectory: Vec<Key>,
    /// Settings of the haptic device and the haptic loop.
    pub haptics: Haptics,
    /// Skin vertices whose positions are recorded.
    pub probes: Vec<Probe>,
    /// The preset (a named set of settings) that the scene names, and the settings whose values come from the preset.
    pub preset: Option<preset::Chosen>,
}

/// Settings of `[step]`.
#[derive(Debug, Clone)]
pub struct Step {
    /// Time step, s.
    pub dt: f64,
    /// Acceleration of gravity, m/s^2.
    pub gravity: DVec3,
    /// Number of Newton iterations per step.
    pub newton: u32,
}

/// Settings of `[solver]`: conjugate gradients for the linear system of each Newton iteration.
#[derive(Debug, Clone)]
pub struct Solver {
    /// Relative residual at which the solver stops. `None`: it stops between 1e-2 and 1e-5, where the error that it leaves
    /// is small compared with that of the time step.
    pub tolerance: Option<f64>,
    /// Greatest number of iterations of the conjugate gradients.
    pub max_iterations: u32,
    /// Preconditioner.
    pub preconditioner: Preconditioner,
    /// How the operator is applied.
    pub operator: Operator,
}

/// How the elements' part of the linear system's operator is applied to a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operator {
    /// Assembled once a solve as a matrix of 3x3 blocks; matrix-free in a scene with F-bar materials, and in one of more
    /// than 16,777,216 nodes.
    Auto,
    /// Element by element in each iteration, without a matrix.
    MatrixFree,
}

impl Operator {
    /// Names that a scene file may give, with their values.
    pub(crate) const CHOICES: [(&str, Operator); 2] = [("auto", Operator::Auto), ("matrix-free", Operator::MatrixFree)];
}

/// The preconditioner of the linear system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preconditioner {
    /// The engine chooses one of the other two, by the stiffness of the bodies.
    Auto,
    /// 3x3 block Jacobi.
    Jacobi,
    /// Two-level additive Schwarz: 3x3 block Jacobi and a coarse space.
    Coarse,
}

impl Preconditioner {
    /// Names that a scene file may give, with their values.
    pub(crate) const CHOICES: [(&str, Preconditioner); 3] =
        [("auto", Preconditioner::Auto), ("jacobi", Preconditioner::Jacobi), ("coarse", Preconditioner::Coarse)];
}

/// Settings of `[contact]`; in `stiffness`, `damping`, `texel` and `depth`, `None` means that the engine chooses. The
/// depth stage (narrow phase) finds the penetration depth of a skin vertex: it looks for a ray hit, that is, a triangle
/// of the other body that is met by the vertex's ray along the contact normal.
#[derive(Debug, Clone)]
pub struct Contact {
    /// Penalty stiffness per contact area (projected along the contact normal), N/m^3.
    pub stiffness: Option<f64>,
    /// Penalty damping per contact area (projected along the contact normal), N s/m^3.
    pub damping: Option<f64>,
    /// Coulomb's coefficient of friction.
    pub friction: f64,
    /// Speed below which friction is viscous instead of Coulomb friction, m/s.
    pub friction_speed: f64,
    /// Edge of the grid cells in which the depth stage looks for ray hits, m. It changes how long the search takes, not
    /// the result.
    pub texel: Option<f64>,
    /// Penetration depth above which a step sets a flag (a warning bit) in its results, m.
    pub depth_limit: f64,
    /// How the depth stage is run; `None`: the engine measures both ways, and takes the faster one.
    pub depth: Option<DepthPath>,
    /// The bodies whose skin vertices are tested for contact.
    pub sides: Sides,
    /// What of a skin is tested for contact.
    pub samples: Samples,
}

/// The bodies whose skin vertices are tested for contact, where two bodies may touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// Both bodies; each contact area counts half, since vertices of both skins are tested.
    Both,
    /// Only the body with the finer skin (less area per vertex); its contact areas count in full.
    One,
}

impl Sides {
    /// Names that a scene file may give, with their values.
    pub const CHOICES: [(&str, Sides); 2] = [("both", Sides::Both), ("one", Sides::One)];
}

/// What of a skin is tested for contact, where two bodies may touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// The engine chooses one of the other two for each pair of bodies: triangles where one body is rigid, nearly convex
    /// and has sharp edges or a skin coarser than the other body's, or where the other's skin is too coarse for vertices.
    Auto,
    /// Vertices: each stands for the skin around it.
    Vertices,
    /// Triangles of the skin that a rigid, nearly convex body touches: depth is integrated over each of them. Pairs
    /// without such a body are tested by vertices.
    Triangles,
}

impl Samples {
    /// Names that a scene file may give, with their values.
    pub const CHOICES: [(&str, Samples); 3] =
        [("auto", Samples::Auto), ("vertices", Samples::Vertices), ("triangles", Samples::Triangles)];
}

/// How the depth stage (narrow phase) finds the triangles that the rays of the other body's vertices meet; both ways
/// give the same result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthPath {
    /// The rasterizer of the graphics pipeline distributes the work.
    Graphics,
    /// Loops in a compute shader do all the work.
    Compute,
}

impl DepthPath {
    /// Names that a scene file or the command line may give, with their values; `None` chooses by measuring.
    pub const CHOICES: [(&str, Option<DepthPath>); 3] =
        [("auto", None), ("graphics", Some(DepthPath::Graphics)), ("compute", Some(DepthPath::Compute))];

    /// Name by which reports call this way of finding the triangles.
    pub fn name(self) -> &'static str {
        match self {
            DepthPath::Graphics => "graphics",
            DepthPath::Compute => "compute",
        }
    }
}

/// A body, `[[body]]`.
#[derive(Debug, Clone)]
pub struct Body {
    /// Name of the body, unique in the scene.
    pub name: String,
    /// The kind of the body (soft, rigid or plane), and the meshes that the body is made of.
    pub shape: Shape,
    /// Greatest number of collision proxies (convex hulls that cover the skin); `None`: the default number.
    pub hulls: Option<u32>,
    /// Length of the unit of file coordinates, m; `None`: the scene does not say, and metres are taken.
    pub units: Option<f64>,
    /// Factor by which file coordinates are multiplied besides.
    pub scale: f64,
    /// World position of the origin of file coordinates, m.
    pub position: DVec3,
    /// Rotation from file coordinates to world axes.
    pub orientation: DQuat,
    /// Initial velocity, world, m/s.
    pub velocity: DVec3,
    /// Elastic material; `None` for rigid bodies.
    pub material: Option<Material>,
    /// The volume over which a soft body's volumetric strain is taken to be constant.
    pub dilatation: Dilatation,
    /// Parts of a soft body that have another material.
    pub regions: Vec<Region>,
    /// Names of the bodies with which this body collides ("tool" for the tool); `None`: all other bodies, but of two tools
    /// neither the other.
    pub collides: Option<Vec<String>>,
    /// Rigid cores. If the body has a skeleton (bones that are cores), the cores of the bones come first, in the order
    /// of the bones.
    pub cores: Vec<Core>,
    /// Ball joints between cores.
    pub joints: Vec<Joint>,
    /// Supports of a soft body, which hold nodes of its layer from outside.
    pub supports: Vec<Support>,
    /// Loads on the body.
    pub loads: Vec<Load>,
    /// Whether steps report what holds the body: force and torque of its fixed and driven cores and of its supports.
    /// `None`: they do if the body has supports.
    pub reactions: Option<bool>,
    /// Whether a faulty surface is repaired; otherwise it is refused.
    pub repair: bool,
    /// Skeleton: bones with their parents and joints; `None`: the body has no skeleton.
    pub skeleton: Option<Skeleton>,
}

impl Body {
    /// A body of this shape at the origin; the settings that are not arguments have their default values.
    fn of(name: &str, shape: Shape, material: Option<Material>, cores: Vec<Core>) -> Body {
        Body {
            name: name.into(),
            shape,
            hulls: None,
            units: None,
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
            supports: Vec::new(),
            loads: Vec::new(),
            reactions: None,
            repair: true,
            skeleton: None,
        }
    }

    /// Whether steps report what holds the body.
    pub(crate) fn reports_reactions(&self) -> bool {
        self.reactions.unwrap_or(!self.supports.is_empty())
    }

    /// Names of the reactions that a body may report: `BODY.NAME` for each of its cores and supports.
    pub(crate) fn reaction_names(&self) -> impl Iterator<Item = String> {
        let names = self.cores.iter().map(|core| &core.name).chain(self.supports.iter().map(|support| &support.name));
        names.filter(|_| self.reports_reactions()).map(|name| format!("{}.{name}", self.name))
    }

    /// A soft body with a skin, `surface`, and a layer. No node is attached yet: add cores to hold the body.
    pub fn soft(name: &str, surface: Surface, layer: Layer, material: Material) -> Body {
        Body::of(name, Shape::Soft { surface: Some(surface), layer }, Some(material), Vec::new())
    }

    /// A soft box of `cells` cells between the corners `low` and `high` (m); its boundary is its skin.
    pub fn block(name: &str, low: [f64; 3], high: [f64; 3], cells: [u32; 3], material: Material) -> Body {
        let layer = Layer::Box { low: low.into(), high: high.into(), cells };
        Body::of(name, Shape::Soft { surface: None, layer }, Some(material), Vec::new())
    }

    /// A rigid body; a dynamic one needs a mass (kg).
    pub fn rigid(name: &str, surface: Surface, motion: Motion, mass: Option<f64>) -> Body {
        let core = Core { name: name.into(), motion, bind: None, mass, hinge: None };
        Body::of(name, Shape::Rigid { surface }, None, vec![core])
    }

    /// A fixed half-space: the points x (m) with `normal . x <= offset`. The `normal` may have any length except zero.
    pub fn plane(name: &str, normal: [f64; 3], offset: f64) -> Body {
        let (normal, length) = (DVec3::from(normal), DVec3::from(normal).length());
        Body::of(name, Shape::Plane { normal: normal / length, offset: offset / length }, None, Vec::new())
    }

    /// Moves the origin of the body's mesh to a world position, m.
    pub fn at(self, position: [f64; 3]) -> Body {
        Body { position: position.into(), ..self }
    }
}

/// The kind of a body, and the meshes that it is made of.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A soft body: a tetrahedral layer and a skin.
    Soft {
        /// Skin of the body; `None`: the boundary of the layer is the skin.
        surface: Option<Surface>,
        /// Tetrahedral mesh that is simulated.
        layer: Layer,
    },
    /// A rigid body, which has only a skin. It has exactly one core, without `bind`, which gives the body's motion.
    Rigid {
        /// Skin of the body.
        surface: Surface,
    },
    /// A fixed, rigid half-space: the points x with `normal . x <= offset`.
    Plane {
        /// Unit outward normal, in world axes.
        normal: DVec3,
        /// Signed distance of the boundary plane from the world's origin, m.
        offset: f64,
    },
}

/// Where a skin comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Surface {
    /// A file with a triangle mesh.
    File(PathBuf),
    /// A model that the engine generates.
    Model {
        /// The model.
        model: Model,
        /// Number of skin vertices, within [`Model::vertices`].
        vertices: usize,
    },
    /// A mesh in memory, see [`Surface::of_triangles`].
    #[doc(hidden)]
    Mesh(Arc<triangles::TriangleMesh>),
}

impl Surface {
    /// A surface in memory, which is treated like a file: vertices (m, before the body's scale), and triangles
    /// that are counter-clockwise seen from outside.
    ///
    /// # Errors
    /// A coordinate is not finite, a triangle names a vertex that does not exist, or no triangle has any area.
    pub fn of_triangles(vertices: Vec<DVec3>, triangles: &[[u32; 3]]) -> Result<Surface> {
        meshes::surface("in memory", vertices, triangles).map(|mesh| Surface::Mesh(Arc::new(mesh)))
    }
}

/// Where a layer, the tetrahedral mesh of a soft body, comes from.
#[derive(Debug, Clone)]
pub enum Layer {
    /// A mesh that the engine generates to fill the surface, from the cells of a lattice (isosurface stuffing).
    Cell {
        /// Edge of the lattice's cubic cells, m in file coordinates.
        cell: f64,
        /// Edge of the largest cells, deep inside, as a multiple of `cell`: 1 (all equal), 2, 4 or 8.
        grade: u32,
        /// Thickness of the shell below the surface that is filled, m in file coordinates; `None`: the whole inside is
        /// filled.
        thickness: Option<f64>,
    },
    /// Like `Cell`, but the scene gives a number of cells in place of the cell's edge.
    Across {
        /// Number of lattice cells along the largest extent of the surface.
        cells: u32,
        /// Edge of the largest cells, deep inside, as a multiple of those at the surface: 1 (all equal), 2, 4 or 8.
        grade: u32,
        /// Thickness of the shell below the surface that is filled, m in file coordinates; `None`: the whole inside is
        /// filled.
        thickness: Option<f64>,
    },
    /// A file with a tetrahedral mesh.
    File(PathBuf),
    /// A mesh in memory, see [`Layer::of_tetrahedra`].
    #[doc(hidden)]
    Mesh(Arc<tetrahedra::TetMesh>),
    /// A box of cells. Each cell is cut into six tetrahedra (Kuhn's subdivision) around the diagonal from its least to
    /// its greatest corner.
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
        /// Number of cells along each axis.
        cells: [u32; 3],
    },
}

impl Layer {
    /// A layer in memory, which is treated like a mesh file: nodes (m, before the body's scale) and tetrahedra.
    /// Tetrahedra of negative volume are reordered.
    ///
    /// # Errors
    /// A coordinate is not finite, or a tetrahedron names a node that does not exist, has no volume or is given twice.
    pub fn of_tetrahedra(nodes: Vec<DVec3>, tetrahedra: &[[u32; 4]]) -> Result<Layer> {
        meshes::layer("in memory", nodes, tetrahedra).map(|mesh| Layer::Mesh(Arc::new(mesh)))
    }
}

/// A rigid core of a body, `[[body.core]]`.
#[derive(Debug, Clone)]
pub struct Core {
    /// Name of the core, unique in its body.
    pub name: String,
    /// How the core moves.
    pub motion: Motion,
    /// The nodes that are attached to the core, so that they move with it; `None` for the core of a rigid body.
    pub bind: Option<Bind>,
    /// Mass of a dynamic core, kg; `None`: the mass of its attached nodes.
    pub mass: Option<f64>,
    /// The only line about which a dynamic core may rotate; `None`: the core moves freely.
    pub hinge: Option<Hinge>,
}

impl Core {
    fn of(name: &str, motion: Motion, bind: Bind) -> Core {
        Core { name: name.into(), motion, bind: Some(bind), mass: None, hinge: None }
    }

    /// A core that never moves.
    pub fn fixed(name: &str, bind: Bind) -> Core {
        Core::of(name, Motion::Fixed, bind)
    }

    /// A kinematic core that follows the poses of `keys`.
    pub fn kinematic(name: &str, bind: Bind, keys: Vec<Key>) -> Core {
        Core::of(name, Motion::Kinematic(keys), bind)
    }

    /// A core that moves by the forces on it, with the mass that its attached nodes have.
    pub fn dynamic(name: &str, bind: Bind) -> Core {
        Core::of(name, Motion::Dynamic, bind)
    }
}

/// The axis of a hinge: a line that is fixed both in the world and in the core, in file coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hinge {
    /// A point on the line.
    pub point: DVec3,
    /// Unit direction of the line.
    pub axis: DVec3,
}

/// How a core moves.
#[derive(Debug, Clone)]
pub enum Motion {
    /// The core does not move.
    Fixed,
    /// The core follows keys (world poses of the body's file coordinates at given times), whatever touches the core.
    Kinematic(Vec<Key>),
    /// The core moves by the forces on it.
    Dynamic,
}

/// Selects the nodes that are attached to a core; boxes, spheres and capsules are in file coordinates.
#[derive(Debug, Clone)]
pub enum Bind {
    /// The nodes at least this deep below the skin, m in file coordinates.
    Inset(f64),
    /// The nodes in a box.
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
    },
    /// The nodes in a sphere.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius.
        radius: f64,
    },
    /// The nodes in the capsule of a bone of the skeleton. A node in several capsules belongs to the nearest bone; see
    /// [`crate::prepare::bind::nearer_bones`].
    Capsule(Capsule),
    /// The nodes with these indices, zero-based, in the order of the layer's mesh.
    Nodes(Vec<u32>),
    /// The nodes of a group that the layer's file defines.
    Group(Group),
    /// All nodes.
    All,
}

/// A rod with round ends, whose radius varies linearly from one end to the other; in file coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// Centres of the two ends; they may coincide.
    pub ends: [DVec3; 2],
    /// Radius at each end.
    pub radii: [f64; 2],
}

/// One pose of a trajectory.
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
    /// A key at this time (s) and position (m), with the identity as orientation.
    pub fn at(time: f64, position: [f64; 3]) -> Key {
        Key { time, position: position.into(), orientation: DQuat::IDENTITY }
    }
}

/// The tool, `[tool]`: the body that the haptic device moves through the virtual coupling.
#[derive(Debug, Clone)]
pub struct Tool {
    /// Name of the tool; "tool" where it is the only one.
    pub name: String,
    /// Shape of the tool.
    pub shape: ToolShape,
    /// Mass, kg.
    pub mass: f64,
    /// World position of the tool's centre of mass at the start, m.
    pub position: DVec3,
    /// World orientation at the start.
    pub orientation: DQuat,
    /// Initial velocity, world, m/s.
    pub velocity: DVec3,
    /// Length of the unit of file coordinates, m; `None`: the scene does not say, and metres are taken.
    pub units: Option<f64>,
    /// Factor by which file coordinates are multiplied besides.
    pub scale: f64,
    /// Whether a faulty surface is repaired; otherwise it is refused.
    pub repair: bool,
}

impl Tool {
    fn of(shape: ToolShape, mass: f64) -> Tool {
        let (position, orientation, velocity) = (DVec3::ZERO, DQuat::IDENTITY, DVec3::ZERO);
        let name = load::TOOL.into();
        Tool { name, shape, mass, position, orientation, velocity, units: None, scale: 1.0, repair: true }
    }

    /// A sphere of this radius (m) and mass (kg), at the origin.
    pub fn sphere(radius: f64, mass: f64) -> Tool {
        Tool::of(ToolShape::Sphere(radius), mass)
    }

    /// A rigid tool with this closed surface and mass (kg), at the origin.
    pub fn surface(surface: Surface, mass: f64) -> Tool {
        Tool::of(ToolShape::Surface(surface), mass)
    }

    /// A body of the scene as the tool; the coupling acts on its first core, which must be dynamic.
    pub fn body(name: &str) -> Tool {
        Tool::of(ToolShape::Body(name.into()), 0.0)
    }

    /// Moves the tool to another world position, m.
    pub fn at(self, position: [f64; 3]) -> Tool {
        Tool { position: position.into(), ..self }
    }
}

/// A tool after the first of several, `[[tool]]`: a body of the scene that a haptic device of its own leads.
#[derive(Debug, Clone)]
pub struct FurtherTool {
    /// Name of the tool.
    pub name: String,
    /// Name of the body; the coupling acts on its first core, which must be dynamic.
    pub body: String,
    /// Virtual coupling between this tool and its haptic device; `None`: nothing holds the tool.
    pub coupling: Option<Coupling>,
    /// Reference trajectory of this tool's haptic device. If empty, the device rests where the tool starts.
    pub trajectory: Vec<Key>,
    /// Settings of this tool's haptic device and haptic loop. `None`: in a session a scripted device leads it, if a tool
    /// after it has settings; otherwise it follows its trajectory.
    pub haptics: Option<Haptics>,
}

/// Shape of the tool.
#[derive(Debug, Clone)]
pub enum ToolShape {
    /// A sphere of this radius, m.
    Sphere(f64),
    /// A rigid tool with this closed surface.
    Surface(Surface),
    /// The body of the scene that has this name; the coupling acts on its first core, which must be dynamic.
    Body(String),
}

impl ToolShape {
    /// Radius of a sphere, m; `None` for other shapes.
    pub fn radius(&self) -> Option<f64> {
        if let ToolShape::Sphere(radius) = self { Some(*radius) } else { None }
    }
}

/// The virtual coupling between haptic device and tool, `[coupling]` (Colgate et al. 1995): springs and dampers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Coupling {
    /// Force per distance between device and tool, N/m.
    pub stiffness: f64,
    /// Force per difference between the velocities of device and tool, N s/m.
    pub damping: f64,
    /// Torque per angle between the orientations of device and tool, N m/rad.
    pub angular_stiffness: f64,
    /// Torque per difference between the angular velocities of device and tool, N m s/rad.
    pub angular_damping: f64,
}

/// A probe, `[[probe]]`: a skin vertex whose position is recorded in the trace.
#[derive(Debug, Clone)]
pub struct Probe {
    /// Name of the probe; the names of the probe's columns in the trace begin with it.
    pub name: String,
    /// Name of the body that the vertex belongs to.
    pub body: String,
    /// The probe is the skin vertex nearest to this point, in file coordinates.
    pub nearest: DVec3,
}
