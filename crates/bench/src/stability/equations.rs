//! The residual b - A x of the linear system that the engine solves in a step, computed in f64. The stability matrix
//! (many stiff and extreme simulations, each judged by invariants) uses the residual to check the solver. The matrices
//! are those of the equations as they are written in the literature. x is the change of the velocities of the nodes and
//! of the tool (rigid body that the haptic device leads by a virtual coupling, a spring and damper), b are impulses (N
//! s), and A has the unit of mass (kg). The terms are elasticity linearised at the start of the step, damping, weight,
//! contacts, and the tool with its virtual coupling.

use glam::{DQuat, DVec3};
use palpate::RigidState;
use palpate::internal::step::tool::Tool;
use palpate_oracle::elastic::Weight;
use palpate_oracle::step::SoftBody;

use super::touch::{Motion, Pressing};
use super::trace::{HALF_ULP, ROUNDINGS};

/// The body and the tool at the start of a step, with the body's elasticity linearised in that state.
pub struct Before {
    body: SoftBody,
    rotations: Vec<DQuat>,
    tool: Option<Tool>,
}

/// Inputs and results of the step.
pub struct Done<'a> {
    /// Length of the step, s.
    pub h: f64,
    /// Gravity, m/s^2.
    pub gravity: DVec3,
    /// Velocities of the nodes at the end of the step, m/s.
    pub end: &'a [DVec3],
    /// The tool and the haptic device at the end of the step; `None` without a tool.
    pub tool: Option<(&'a Tool, RigidState)>,
    /// Contacts that act. The solver releases (gives no stiffness to) contacts that would pull; those are left out
    /// here.
    pub contacts: &'a [Pressing],
}

/// Squared norms of vectors of the system: each is the sum of the squares of the vector's entries, each square divided
/// by the entry of A's diagonal for that equation.
#[derive(Debug, Clone, Copy, Default)]
pub struct Left {
    /// Squared norm of the residual b - A x.
    pub left2: f64,
    /// Squared norm of b, plus that of the weight, since b is small for nodes on which forces cancel.
    pub size2: f64,
    /// Squared norm of the residual that f32 rounding alone may cause.
    pub floor2: f64,
}

/// Contact terms of the three equations of a node, or of one equation of the tool: the impulses of the contacts with
/// the velocities at the step's end and at its start (N s), the rounding error of these impulses (N s), and the
/// contacts' term on A's diagonal (kg).
#[derive(Clone, Copy, Default)]
struct Pushed {
    end: DVec3,
    start: DVec3,
    rounding: f64,
    diagonal: f64,
}

impl Before {
    /// Linearises the body's elasticity at its present state; `rotations` has the rotation of each tetrahedron.
    pub fn of(body: &SoftBody, rotations: &[DQuat], tool: Option<&Tool>) -> Before {
        let rotations = rotations.to_vec();
        let mut body = body.clone();
        body.elements = body.elements.linearised(&body.displacement, &rotations);
        Before { body, rotations, tool: tool.cloned() }
    }

    /// Squared norms of the residual after the step, of b, and of the residual that rounding may cause.
    pub fn left(&self, done: &Done) -> Left {
        let (h, elements) = (done.h, &self.body.elements);
        let (start, end) = (&self.body.velocity, done.end);
        let change: Vec<DVec3> = start.iter().zip(end).map(|(start, end)| *end - *start).collect();
        let stiff = elements.apply_weighted(&change, &self.rotations, |material| Weight::of_step(h, material));
        let impulses = elements.impulses(&self.body.displacement, &self.rotations, start, None, h);
        let sizes = self.sizes(h, start, end);
        let pushed = self.pushed(done);
        let mut left = Left::default();
        for i in (0..start.len()).filter(|i| !self.body.layer.attached[*i]) {
            let (mass, damping, push) = (elements.masses[i], elements.damping[i], &pushed[i]);
            // What supports take from the equations of a node is left to the forces that hold it.
            let left_to = self.body.supports[i];
            let own = impulses[i] + h * mass * done.gravity - h * damping * start[i];
            let image = (mass + h * damping) * change[i] + stiff[i];
            let diagonal = mass + h * damping + sizes[i].0 + push.diagonal;
            let floor = sizes[i].1
                + mass * (start[i].length() + end[i].length() + h * done.gravity.length())
                + h * damping * (start[i].length() + end[i].length());
            left.left2 += (left_to * (own + push.end - image)).length_squared() / diagonal;
            // Where forces cancel, b is small; the weight still shows how large they are.
            let weight2 = (h * mass * done.gravity).length_squared();
            left.size2 += ((left_to * (own + push.start)).length_squared() + weight2) / diagonal;
            left.floor2 += (ROUNDINGS * HALF_ULP * floor + push.rounding).powi(2) / diagonal;
        }
        self.tool_rows(done, &mut left);
        left
    }

    fn motions<'a>(&'a self, done: &Done<'a>) -> [Motion<'a>; 2] {
        let motion = |nodes, tool: Option<&Tool>| Motion {
            nodes,
            linear: tool.map_or(DVec3::ZERO, |tool| tool.velocity),
            angular: tool.map_or(DVec3::ZERO, |tool| tool.angular_velocity),
        };
        [motion(&self.body.velocity, self.tool.as_ref()), motion(done.end, done.tool.as_ref().map(|(tool, _)| *tool))]
    }

    /// Contact terms of the equations of all nodes.
    fn pushed(&self, done: &Done) -> Vec<Pushed> {
        let mut pushed = vec![Pushed::default(); self.body.velocity.len()];
        let [start, end] = self.motions(done);
        let h = done.h;
        for contact in done.contacts {
            let rounding = h * (contact.rounding(h, &start) + contact.rounding(h, &end));
            let (push, at_start) = (contact.push(h, &end), contact.push(h, &start));
            for (node, weight) in &contact.nodes {
                let at = &mut pushed[*node];
                at.end -= h * weight * push * contact.normal();
                at.start -= h * weight * at_start * contact.normal();
                at.rounding += weight.abs() * rounding;
                at.diagonal += h * contact.slope(h) * weight * weight;
            }
        }
        pushed
    }

    /// Adds the six equations of the tool to `left`.
    fn tool_rows(&self, done: &Done, left: &mut Left) {
        let (Some(before), Some((after, device))) = (&self.tool, &done.tool) else { return };
        let h = done.h;
        let rows = before.rows(h, done.gravity, device);
        let linear = after.velocity - before.velocity;
        let angular = after.angular_velocity - before.angular_velocity;
        let change = [linear.to_array(), angular.to_array()].concat();
        let speeds = [
            before.velocity.length() + after.velocity.length(),
            before.angular_velocity.length() + after.angular_velocity.length(),
        ];
        let [start, end] = self.motions(done);
        for k in 0..6 {
            let image: f64 = rows.matrix[k].iter().zip(&change).map(|(a, x)| a * x).sum();
            let size: f64 = rows.matrix[k].iter().enumerate().map(|(l, a)| a.abs() * speeds[l / 3]).sum();
            let mut push = Pushed { diagonal: rows.matrix[k][k], ..Pushed::default() };
            let (mut of_end, mut of_start) = (rows.rhs[k], rows.rhs[k]);
            for contact in done.contacts {
                let column = contact.tool[k / 3][k % 3];
                of_end -= h * column * contact.push(h, &end);
                of_start -= h * column * contact.push(h, &start);
                push.rounding += column.abs() * h * (contact.rounding(h, &start) + contact.rounding(h, &end));
                push.diagonal += h * contact.slope(h) * column * column;
            }
            let floor = ROUNDINGS * HALF_ULP * (size + rows.rhs[k].abs()) + push.rounding;
            left.left2 += (of_end - image).powi(2) / push.diagonal;
            left.size2 += of_start.powi(2) / push.diagonal;
            left.floor2 += floor.powi(2) / push.diagonal;
        }
    }

    /// For each node: an estimate of the elastic term on A's diagonal (kg), and the sum of the magnitudes of the
    /// elastic impulses of its tetrahedra (N s), which bounds the rounding error of these impulses.
    fn sizes(&self, h: f64, start: &[DVec3], end: &[DVec3]) -> Vec<(f64, f64)> {
        let elements = &self.body.elements;
        let mut sizes = vec![(0.0, 0.0); start.len()];
        let spread = |nodes: &[u32; 4], of: &[DVec3]| {
            nodes.iter().map(|i| of[*i as usize].distance(of[nodes[0] as usize])).fold(0.0, f64::max)
        };
        // A velocity is rounded in proportion to its magnitude, even if an element's stress depends only on small
        // differences of velocities.
        let greatest =
            |nodes: &[u32; 4], of: &[DVec3]| nodes.iter().map(|i| of[*i as usize].length()).fold(0.0, f64::max);
        for (e, nodes) in elements.tetrahedra.iter().enumerate() {
            let operator = &elements.operators[e];
            let modulus = 2.0 * operator.mu + operator.lambda.abs();
            let steep = elements.gradients[e].iter().map(|g| g.length_squared()).fold(0.0, f64::max);
            let (stiffness, beta) = (elements.volumes[e] * modulus * steep, elements.materials[e].damping_stiffness);
            let lag = h * (h + beta) * stiffness;
            let size = h * stiffness * spread(nodes, &self.body.displacement)
                + lag * (greatest(nodes, start) + greatest(nodes, end));
            for i in nodes {
                let at = &mut sizes[*i as usize];
                // The gradients of the four shape functions of a tetrahedron differ; for every node half of the term
                // with the steepest gradient is taken, as an estimate.
                *at = (at.0 + 0.5 * lag, at.1 + size);
            }
        }
        sizes
    }
}
