//! Makes a layered body from its description in a scene and the mesh files that it names. A layered body consists of a
//! *skin* (the high-resolution triangle mesh that is seen and touched), a *layer* (the tetrahedral simulation mesh in
//! which every skin vertex is embedded), rigid *cores* to which nodes of the layer are attached, and *proxies*
//! (convex hulls that cover the skin, for the broad phase of contact). A rigid body has skin and proxies only. The
//! *tool* is the rigid body that a haptic device leads. A *frame* is a rigid coordinate frame in which the
//! displacements of nodes are measured; it moves with the body, and skin and proxies with it.
//!
//! Everything here runs on the host, in f64, before the first step. Positions in a [`Body`] are in its *rest frame*:
//! the coordinates of the body's files times its scale, not yet placed in the world by `position` and `orientation`.

pub mod bind;
pub mod bodies;
mod body;
pub mod cache;
pub mod cores;
pub mod coverage;
pub mod distance;
pub mod embed;
pub mod hull;
mod lattice;
pub mod layer;
pub mod loads;
pub mod mass;
mod materials;
pub mod model;
pub mod patch;
pub mod prepared;
pub mod proxy;
pub mod quality;
pub mod repair;
pub mod report;
mod ride;
pub mod skin;
mod sources;
pub mod sphere;
pub mod stuffing;
pub mod supports;
#[cfg(test)]
pub(crate) mod tests;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

pub use body::{body, body_and_report, tool, watched_tool};
pub use cache::Cache;
pub use embed::embed;
pub use materials::Materials;
pub use proxy::proxies;
pub use report::{Report, Stage};

use crate::scene::{Hinge, Joint, Key};

/// The index that stands for "no element", for example for a neighbour that does not exist.
pub const NONE: u32 = u32::MAX;
/// Greatest number of vertices of a proxy's hull.
pub const MAX_HULL_VERTICES: usize = 64;

/// A body ready to be uploaded to the GPU.
#[derive(Debug, Clone)]
pub struct Body {
    /// Name in the scene.
    pub name: String,
    /// Geometry, materials and kinematics of the body.
    pub shape: Shape,
    /// World position of the rest frame's origin, m.
    pub position: DVec3,
    /// World orientation of the rest frame.
    pub orientation: DQuat,
    /// Initial velocity in world axes, m/s.
    pub velocity: DVec3,
    /// Loads on the body.
    pub loads: Vec<loads::Load>,
    /// Findings in the body's files, and the changes made to their contents.
    pub report: BodyReport,
}

/// Findings in a body's files, and the changes made to their contents.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct BodyReport {
    /// Report on the repair of the surface, or of the layer's boundary if the boundary is the skin; `None` if the
    /// engine generated the surface and the layer itself.
    pub repair: Option<repair::RepairReport>,
    /// Everything that was changed or left out, one line each, which begins with the name of the file or scene key.
    pub notes: Vec<String>,
}

/// The prepared geometry of a body, by its kind.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A deformable body: a layer, and a skin embedded in it.
    Soft {
        /// The tetrahedral simulation mesh.
        layer: Layer,
        /// The rigid frames of the body: one for each core, then a fixed one if it has supports; or one floating frame for a
        /// body without either.
        frames: Vec<Frame>,
        /// Index of the frame in which the displacement of each node is measured.
        node_frames: Vec<u32>,
        /// What holds the body from outside.
        supports: supports::Supports,
        /// Joints between frames; their points are in the rest frame, m.
        joints: Vec<Joint>,
        /// Materials of the tetrahedra.
        materials: Materials,
        /// Embedding of each skin vertex in the layer.
        embedding: Vec<Embedding>,
        /// The surface that is seen and touched.
        skin: Skin,
        /// Convex hulls that cover the skin.
        proxies: Vec<Proxy>,
    },
    /// A rigid body: its skin follows one frame.
    Rigid {
        /// The surface that is seen and touched.
        skin: Skin,
        /// Convex hulls that cover the skin.
        proxies: Vec<Proxy>,
        /// Enclosed volume, m^3.
        volume: f64,
        /// Centroid of the enclosed volume, rest frame, m.
        centroid: DVec3,
        /// Inertia tensor about the centroid for unit density (kg m^2 per kg/m^3), rest-frame axes.
        inertia: DMat3,
        /// How the body moves. The tool has [`FrameMotion::Fixed`] here, because the haptic loop on the host moves it.
        motion: FrameMotion,
    },
    /// The half-space `normal . x <= offset` in world axes, which has no skin.
    Plane {
        /// Unit normal that points out of the half-space.
        normal: DVec3,
        /// Distance of the plane from the world's origin along the normal, m.
        offset: f64,
    },
}

/// A rigid coordinate frame of a body, which nodes, skin and proxies follow.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Origin of the frame at rest, in the rest frame of the body, m.
    pub centre: DVec3,
    /// Motion of the frame.
    pub motion: FrameMotion,
}

/// Motion of a rigid frame.
#[derive(Debug, Clone)]
pub enum FrameMotion {
    /// The frame stays where the body was placed.
    Fixed,
    /// Kinematic motion along keys. A key gives the world pose of the body's rest frame at a time: a key that equals
    /// the body's own `position` and `orientation` leaves the frame where it was at rest.
    Kinematic(Vec<Key>),
    /// Forces move the frame. Its origin is the centre of mass of the nodes attached to the core, or the hinge's point.
    Dynamic {
        /// Mass of the core, kg; `None`: the core has the lumped mass of its attached nodes.
        mass: Option<f64>,
        /// The line about which alone the frame may rotate (rest frame, m); the frame's origin is then the hinge's
        /// point. `None`: the frame moves freely.
        hinge: Option<Hinge>,
    },
    /// The frame follows the free nodes of a body without cores by shape matching (M. Mueller and others 2005).
    Floating {
        /// Mass of all nodes, kg.
        mass: f64,
        /// Inertia tensor of the masses lumped at the nodes about the frame's origin, rest-frame axes, kg m^2.
        inertia: DMat3,
    },
}

/// A tetrahedral simulation mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Rest positions of the nodes, in file order, m.
    pub nodes: Vec<DVec3>,
    /// The four nodes of each tetrahedron, ordered so that its volume is positive.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Whether each node is attached to one of the body's cores.
    pub attached: Vec<bool>,
    /// Index of the F-bar patch of each tetrahedron ([`patch::patches`]), over which the volumetric strain is averaged;
    /// empty if every tetrahedron uses its own volumetric strain.
    #[serde(skip)]
    pub patches: Vec<u32>,
}

/// The triangle mesh that is seen and touched.
#[derive(Debug, Clone, Default)]
pub struct Skin {
    /// Rest positions of the vertices, in the order of the vertices in the file, m.
    pub vertices: Vec<DVec3>,
    /// Vertices of each triangle, counter-clockwise seen from outside; in file order after triangulation.
    pub triangles: Vec<[u32; 3]>,
    /// Rest area that belongs to each vertex: a third of its triangles' areas, m^2.
    pub areas: Vec<f64>,
}

/// Embedding of a skin vertex: its position as a weighted sum of the node positions of one tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Embedding {
    /// Index of the tetrahedron.
    pub tetrahedron: u32,
    /// Barycentric weights of the tetrahedron's four nodes. They sum to one; where the skin leaves the layer, they may
    /// lie outside [0, 1].
    pub weights: [f64; 4],
}

impl Embedding {
    /// The weighted sum of vectors of the tetrahedron's nodes; `at_nodes` has a vector for each node of the mesh.
    pub fn interpolate(&self, tetrahedra: &[[u32; 4]], at_nodes: &[DVec3]) -> DVec3 {
        let nodes = tetrahedra[self.tetrahedron as usize];
        nodes.iter().zip(self.weights).map(|(node, weight)| weight * at_nodes[*node as usize]).sum()
    }
}

/// A convex collision proxy: a convex hull that covers part of the skin.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Proxy {
    /// Index of the body's frame that the proxy follows.
    pub frame: u32,
    /// Vertices of the hull, rest frame, m; at most [`MAX_HULL_VERTICES`].
    pub hull: Vec<DVec3>,
    /// Distinct face planes of the hull: unit outward normal n and offset (m), where n . x <= offset inside.
    pub faces: Vec<(DVec3, f64)>,
    /// Skin vertices that this proxy owns; each skin vertex has exactly one owner.
    pub vertices: Vec<u32>,
    /// Skin triangles that this proxy owns, which the narrow phase processes if the proxy may touch; each triangle has
    /// exactly one owner.
    pub triangles: Vec<u32>,
    /// Greatest distance of the owned triangles' vertices outside the hull at rest, m.
    pub margin: f64,
}
