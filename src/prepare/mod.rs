//! From what a user wrote to a layered body: layer, embedding, proxies, bindings.
//!
//! Everything here is on the host, in f64, before the first step. Coordinates of a [`Body`] are its *rest frame*: file
//! coordinates times scale, not yet placed in the world by `position` and `orientation`.

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

/// No element: the index that points nowhere.
pub const NONE: u32 = u32::MAX;
/// Vertices of a proxy's hull at most.
pub const MAX_HULL_VERTICES: usize = 64;

/// A body ready to be uploaded.
#[derive(Debug, Clone)]
pub struct Body {
    /// Name in the scene.
    pub name: String,
    /// What the world touches.
    pub shape: Shape,
    /// World position of the rest frame's origin, m.
    pub position: DVec3,
    /// World orientation of the rest frame.
    pub orientation: DQuat,
    /// Initial velocity, world, m/s.
    pub velocity: DVec3,
    /// What was found in its files, and done about it.
    pub report: BodyReport,
}

/// What was found in a body's files, and done about it.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct BodyReport {
    /// The repair of the surface, or of the layer's boundary where that is the skin; `None` where it is from no file.
    pub repair: Option<repair::RepairReport>,
    /// Everything that was done to the files, a line each, beginning with the file's name.
    pub notes: Vec<String>,
}

/// What a body is made of, prepared.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A layer that deforms, and a skin embedded in it.
    Soft {
        /// Tetrahedra.
        layer: Layer,
        /// The frames that nodes ride on: one a core, or a floating one.
        frames: Vec<Frame>,
        /// Frame of each node.
        node_frames: Vec<u32>,
        /// Joints between frames; points in the rest frame, m.
        joints: Vec<Joint>,
        /// What each tetrahedron is made of.
        materials: Materials,
        /// Embedding of each skin vertex.
        embedding: Vec<Embedding>,
        /// Skin.
        skin: Skin,
        /// Convex cover of the skin.
        proxies: Vec<Proxy>,
    },
    /// A skin that rides on one frame.
    Rigid {
        /// Skin.
        skin: Skin,
        /// Convex cover of the skin.
        proxies: Vec<Proxy>,
        /// Mass properties for unit density, about the centroid: volume (m^3), centroid (m).
        volume: f64,
        /// Centroid, rest frame.
        centroid: DVec3,
        /// Inertia tensor about the centroid for unit density, kg m^2 per kg/m^3, rest-frame axes, columns.
        inertia: DMat3,
        /// How it moves; the tool's is the host's business.
        motion: FrameMotion,
    },
    /// Half-space `normal . x <= offset` in world axes; skinless.
    Plane {
        /// Unit outward normal.
        normal: DVec3,
        /// Offset, m.
        offset: f64,
    },
}

/// A rigid frame of a body.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Its centre at rest, rest frame of the body, m.
    pub centre: DVec3,
    /// How it moves.
    pub motion: FrameMotion,
}

/// How a frame moves.
#[derive(Debug, Clone)]
pub enum FrameMotion {
    /// It stays where the body was placed.
    Fixed,
    /// Along poses that it gives to the body's rest frame (world): at the body's own `position` and `orientation` the
    /// frame is where it was at rest.
    Driven(Vec<Key>),
    /// By forces; its centre is that of the mass it carries, where no hinge holds it.
    Dynamic {
        /// kg; `None`: that of the nodes it carries.
        mass: Option<f64>,
        /// All that it may turn about, rest frame, m; then its centre is the hinge's point.
        hinge: Option<Hinge>,
    },
    /// It follows the free nodes of a body without cores (shape matching, M. Mueller and others 2005).
    Floating {
        /// Of all nodes, kg.
        mass: f64,
        /// Of the lumped nodes about the centre, rest axes, kg m^2.
        inertia: DMat3,
    },
}

/// The tetrahedral mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Rest positions, in file order.
    pub nodes: Vec<DVec3>,
    /// Four node indices each, positive volume.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Whether each node rides on one of the body's cores.
    pub bound: Vec<bool>,
    /// The patch of each tetrahedron whose volumetric strain is its patch's ([`patch::patches`]); empty: each has its own.
    #[serde(skip)]
    pub patches: Vec<u32>,
}

/// A triangle mesh that touches and is seen.
#[derive(Debug, Clone, Default)]
pub struct Skin {
    /// Rest positions, in the order of the file's `v` lines.
    pub vertices: Vec<DVec3>,
    /// Counter-clockwise seen from outside; file order after triangulation.
    pub triangles: Vec<[u32; 3]>,
    /// Neighbour across edge k (from vertex k to vertex k+1), or [`NONE`] at a boundary or non-manifold edge.
    pub neighbours: Vec<[u32; 3]>,
    /// Rest area of each vertex: a third of its triangles' areas, m^2.
    pub areas: Vec<f64>,
}

/// A skin vertex as a weighted sum of the nodes of one tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Embedding {
    /// Tetrahedron.
    pub tetrahedron: u32,
    /// Barycentric weights on its four nodes; they sum to one and may lie outside [0, 1] where the skin leaves the layer.
    pub weights: [f64; 4],
}

/// A convex hull that covers part of the skin.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Proxy {
    /// The body's frame that it rides on.
    pub frame: u32,
    /// Hull vertices, rest frame, at most [`MAX_HULL_VERTICES`].
    pub hull: Vec<DVec3>,
    /// Unit outward normal and offset (n . x <= offset inside) of each distinct hull face.
    pub faces: Vec<(DVec3, f64)>,
    /// Skin vertices this proxy owns: each skin vertex is in exactly one list.
    pub vertices: Vec<u32>,
    /// Skin triangles this proxy owns (and draws): each triangle is in exactly one list.
    pub triangles: Vec<u32>,
    /// How far the vertices of the owned triangles stick out of the hull at rest, m.
    pub margin: f64,
}
