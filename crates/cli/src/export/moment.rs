//! What a moment of a series holds: a copy of the state between two steps.

use glam::DVec3;
use palpate::internal::prepare::Shape;
use palpate::internal::step::{TetrahedronFields, VertexForce};
use palpate::{ContactPoint, Result, Simulation};

/// The state after a step.
pub struct Moment {
    /// Steps done.
    pub steps: u64,
    /// Time, s.
    pub time: f64,
    /// One for each body, the tool's last if it has a body of its own.
    pub bodies: Vec<State>,
    /// Fields of the tetrahedra of all soft bodies, one body after another.
    pub tetrahedra: Option<TetrahedronFields>,
    pub contacts: Vec<ContactPoint>,
    /// Contact forces on vertices of the skins.
    pub forces: Vec<VertexForce>,
}

/// State of a body.
pub enum State {
    Soft {
        /// Displacements of the nodes in the body's own axes, m.
        displacement: Vec<DVec3>,
        /// Velocities of the nodes, world axes, m/s.
        velocity: Vec<DVec3>,
    },
    Rigid {
        /// World positions of the vertices of the skin, m; none for a half-space.
        vertices: Vec<DVec3>,
    },
}

impl Moment {
    /// Reads the present state.
    pub fn of(steps: u64, simulation: &mut Simulation) -> Result<Moment> {
        let count = simulation.skin_ranges().len();
        let is_soft = simulation.bodies().iter().any(|body| matches!(body.shape, Shape::Soft { .. }));
        let tetrahedra = if is_soft { Some(simulation.tetrahedron_fields()?) } else { None };
        let (contacts, forces) = simulation.contacts_and_forces()?;
        let bodies = (0..count).map(|body| match simulation.nodes(body) {
            Ok(Some((displacement, velocity))) => Ok(State::Soft { displacement, velocity }),
            Ok(None) => Ok(State::Rigid { vertices: simulation.vertex_positions(body)? }),
            Err(error) => Err(error),
        });
        let bodies = bodies.collect::<Result<_>>()?;
        Ok(Moment { steps, time: simulation.time(), bodies, tetrahedra, contacts, forces })
    }
}
