//! State of soft bodies and their dynamic cores (rigid cores inside soft bodies, whose motion the solver finds) in the
//! f64 reference implementation, and quantities that follow from the state.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::supports::Supports;
use palpate::internal::prepare::{Embedding, Layer, Materials, Skin};
use palpate::scene::Coupling;

use crate::contact::{Support, Surface};
use crate::elastic::Elements;
use crate::linear::Entries;
use crate::skin;
use crate::tool::{self, Device};

/// A soft body and its state. Its layer is the tetrahedral simulation mesh; its rest frame is the coordinate
/// frame of the undeformed layer.
#[derive(Debug, Clone)]
pub struct SoftBody {
    /// Tetrahedra of the layer, with the masses of its nodes and the rotation from rest axes to world axes.
    pub elements: Elements,
    /// The layer at rest.
    pub layer: Layer,
    /// World position of the rest frame's origin, m; the rest frame does not move.
    pub position: DVec3,
    /// Displacement of each node from rest, rest axes, m.
    pub displacement: Vec<DVec3>,
    /// Velocity of each node, world axes, m/s. For a node attached to a core of prescribed motion it is the velocity
    /// over the next step, which the caller sets; it is zero where the core rests.
    pub velocity: Vec<DVec3>,
    /// For each node the projection of its velocity onto what its supports leave to it, world axes; empty where no node is
    /// supported.
    pub supports: Vec<DMat3>,
    /// Rotation of each tetrahedron for the next steps; `None`: the exact polar rotations at the present displacements.
    pub given_rotations: Option<Vec<DQuat>>,
}

impl SoftBody {
    /// An undeformed body, placed by `position` (m) and `orientation`; free nodes move with `velocity` (world, m/s).
    pub fn new(
        layer: Layer,
        materials: impl Into<Materials>,
        position: DVec3,
        orientation: DQuat,
        velocity: DVec3,
    ) -> Self {
        let elements = Elements::new(&layer, materials, DMat3::from_quat(orientation.normalize()));
        let start = |bound: &bool| if *bound { DVec3::ZERO } else { velocity };
        Self {
            displacement: vec![DVec3::ZERO; layer.nodes.len()],
            velocity: layer.attached.iter().map(start).collect(),
            supports: Vec::new(),
            given_rotations: None,
            elements,
            layer,
            position,
        }
    }

    /// The body with supports: `supports` says for each node what they leave to it, in rest axes.
    pub fn supported(mut self, supports: &Supports) -> Self {
        let frame = self.elements.frame;
        self.supports =
            supports.freedom.iter().map(|freedom| frame * freedom.projection() * frame.transpose()).collect();
        for (velocity, projection) in self.velocity.iter_mut().zip(&self.supports) {
            *velocity = *projection * *velocity;
        }
        self
    }

    /// Rotation of each tetrahedron that the next step uses.
    pub fn rotations(&self) -> Vec<DQuat> {
        self.given_rotations.clone().unwrap_or_else(|| self.elements.rotations(&self.displacement))
    }

    /// World positions of the nodes, m.
    pub fn world_nodes(&self) -> Vec<DVec3> {
        let place = |(r, d): (&DVec3, &DVec3)| self.elements.frame * (*r + *d) + self.position;
        self.layer.nodes.iter().zip(&self.displacement).map(place).collect()
    }

    /// World position of a node, m.
    pub fn world_node(&self, node: u32) -> DVec3 {
        let node = node as usize;
        self.elements.frame * (self.layer.nodes[node] + self.displacement[node]) + self.position
    }

    /// The deformed skin at its world position, for contact tests. `body` is the index of this body in the simulation.
    pub fn surface<'a>(&'a self, body: usize, skin: &'a Skin, embedding: &'a [Embedding]) -> Surface<'a> {
        Surface {
            positions: skin::embed(embedding, &self.layer, &self.world_nodes()),
            triangles: &skin.triangles,
            areas: &skin.areas,
            support: Support::Soft(body, &self.layer, embedding),
        }
    }

    /// Momentum of the nodes, kg m/s.
    pub fn momentum(&self) -> DVec3 {
        self.velocity.iter().zip(&self.elements.masses).map(|(v, m)| *v * *m).sum()
    }

    /// Kinetic plus elastic energy, J.
    pub fn energy(&self) -> f64 {
        let kinetic: f64 =
            self.velocity.iter().zip(&self.elements.masses).map(|(v, m)| 0.5 * m * v.length_squared()).sum();
        kinetic + self.elements.energy(&self.displacement, &self.elements.rotations(&self.displacement))
    }
}

/// A dynamic rigid core, which moves by the forces on the nodes attached to it. Its inertia is that of these nodes, and
/// its centre must be their centre of mass, or a point of its hinge.
#[derive(Debug, Clone)]
pub struct Core {
    /// Each attached node: the index of its body, and its index in the body's layer.
    pub nodes: Vec<(usize, u32)>,
    /// Position of the centre, world, m.
    pub centre: DVec3,
    /// Velocity of the centre, world, m/s.
    pub velocity: DVec3,
    /// Angular velocity, world, rad/s.
    pub spin: DVec3,
    /// Axis (unit, world) of a hinge through the centre: the centre rests, and the core only rotates about the axis.
    /// `None`: no hinge.
    pub hinge: Option<DVec3>,
}

/// A dynamic core that the haptic device holds by virtual coupling.
#[derive(Debug, Clone, Copy)]
pub struct CoupledCore {
    /// Index of the core.
    pub core: usize,
    /// Rotation from core axes to world axes; where it equals the device's orientation, the coupling's angular spring
    /// is relaxed.
    pub orientation: DQuat,
    /// Virtual coupling to the device: spring and damper.
    pub coupling: Coupling,
}

impl CoupledCore {
    /// Adds the virtual coupling over a step of `h` seconds to the step's system, matrix `a` and right-hand side `b`:
    /// to the six equations of the core, which begin at unknown `first`, projected onto the motions that a hinge
    /// allows.
    pub fn add_terms(&self, core: &Core, a: &mut Entries, b: &mut [f64], first: usize, h: f64, device: &Device) {
        let (pose, twist) = ((core.centre, self.orientation), (core.velocity, core.spin));
        let (sizes, impulses) = tool::coupling_terms(&self.coupling, pose, twist, h, device);
        let (linear, angular) = core.freedom();
        for (part, freedom) in [linear, angular].into_iter().enumerate() {
            let (at, impulse) = (first + 3 * part, freedom * impulses[part]);
            a.add_block(at, at, &(freedom * sizes[part]));
            (0..3).for_each(|axis| b[at + axis] += impulse[axis]);
        }
    }

    /// Advances the orientation by the core's spin for `h` seconds.
    pub fn turn(&mut self, h: f64, core: &Core) {
        self.orientation = (DQuat::from_scaled_axis(h * core.spin) * self.orientation).normalize();
    }
}

impl Core {
    /// Projections onto the linear and the angular velocities that the core may have.
    pub fn freedom(&self) -> (DMat3, DMat3) {
        match self.hinge {
            Some(n) => (DMat3::ZERO, DMat3::from_cols(n * n.x, n * n.y, n * n.z)),
            None => (DMat3::IDENTITY, DMat3::IDENTITY),
        }
    }
}
