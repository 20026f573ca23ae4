//! Soft bodies and dynamic cores of the oracle: their state, and what can be read off it.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::{Embedding, Layer, Materials, Skin};
use palpate::scene::Coupling;

use crate::contact::{Support, Surface};
use crate::elastic::Elements;
use crate::linear::Entries;
use crate::skin;
use crate::tool::{self, Device};

/// A soft body and its state.
#[derive(Debug, Clone)]
pub struct SoftBody {
    /// Tetrahedra, masses, frame.
    pub elements: Elements,
    /// The layer at rest.
    pub layer: Layer,
    /// World position of the rest frame's origin, m; the frame rests.
    pub position: DVec3,
    /// Displacement of each node from rest, rest axes, m.
    pub displacement: Vec<DVec3>,
    /// Velocity of each node, world axes, m/s; of a bound node what its core gives it over the next step, which the caller
    /// sets (zero where the core rests).
    pub velocity: Vec<DVec3>,
    /// Element rotations for the next steps; `None`: the exact polar rotations of the displacements.
    pub given_rotations: Option<Vec<DQuat>>,
}

impl SoftBody {
    /// A body at rest in shape, placed by `position` and `orientation`; free nodes move with `velocity` (world).
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
            velocity: layer.bound.iter().map(start).collect(),
            given_rotations: None,
            elements,
            layer,
            position,
        }
    }

    /// Element rotations that the next step uses.
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

    /// The deformed skin in the world, for gathering contacts. `body`: this body's index in the simulation.
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

/// A rigid core that moves by the forces on the nodes it carries; those are bound in their body's layer. Its inertia is
/// theirs, and its centre must be the centre of their masses, or a point of its hinge.
#[derive(Debug, Clone)]
pub struct Core {
    /// Body and node of each.
    pub nodes: Vec<(usize, u32)>,
    /// World, m.
    pub centre: DVec3,
    /// World, m/s.
    pub velocity: DVec3,
    /// World, rad/s.
    pub spin: DVec3,
    /// Unit axis, world, of a hinge through the centre, which rests; about it the core may turn, and that is all.
    pub hinge: Option<DVec3>,
}

/// A dynamic core that the device holds.
#[derive(Debug, Clone, Copy)]
pub struct Held {
    /// Index of the core.
    pub core: usize,
    /// World from core axes, the device's orientation where the coupling is relaxed.
    pub orientation: DQuat,
    /// Spring and damper to the device.
    pub coupling: Coupling,
}

impl Held {
    /// Adds the coupling to the rows of its core, from unknown `first` on, as far as a hinge lets the core follow; step of `h`
    /// seconds.
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

    /// Turns with its core for `h` seconds.
    pub fn turn(&mut self, h: f64, core: &Core) {
        self.orientation = (DQuat::from_scaled_axis(h * core.spin) * self.orientation).normalize();
    }
}

impl Core {
    /// Which linear and angular velocities it may have, as projections.
    pub fn freedom(&self) -> (DMat3, DMat3) {
        match self.hinge {
            Some(n) => (DMat3::ZERO, DMat3::from_cols(n * n.x, n * n.y, n * n.z)),
            None => (DMat3::IDENTITY, DMat3::IDENTITY),
        }
    }
}
