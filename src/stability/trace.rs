//! What a step did, measured from outside in f64: energies, work, and what the equations of motion are missed by. Shares no
//! code with the shaders.

use std::collections::{HashMap, HashSet};

use glam::{DMat3, DQuat, DVec3};

use super::setup::RADIUS;
use crate::Result;
use crate::oracle::step::SoftBody;
use crate::prepare::Shape;
use crate::report::Flags;
use crate::scene::Scene;
use crate::step::Simulation;

/// Half a unit in the last place of f32.
const HALF_ULP: f64 = 6e-8;
/// Roundings that a sum over the elements of a node adds up.
const ROUNDINGS: f64 = 16.0;

/// What one step left, and what was measured of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Whether all that the step tells is finite.
    pub is_finite: bool,
    /// Kinetic, elastic, gravity's and the coupling's, J; of gravity since the start.
    pub energy: f64,
    /// J.
    pub kinetic: f64,
    /// Work of the device, and energy of contacts that were found inside, since the start, J.
    pub supplied: f64,
    /// What bounds rounding of `energy`: the sum of its parts' sizes, J.
    pub turned_over: f64,
    /// What this step and the last leave of their linear systems, of the right-hand sides; the diagonal's norm. While nothing
    /// touches.
    pub residual: f64,
    /// What rounding alone leaves of it.
    pub residual_floor: f64,
    /// What the tool's momentum misses force, weight and coupling by, of the largest of them.
    pub balance: f64,
    /// On the tool, N.
    pub force: f64,
    /// What the contacts can press at most, N.
    pub force_bound: f64,
    /// How far, and which way, the centre of the free nodes is from where it was, m.
    pub moved: DVec3,
    /// Tetrahedra that are inside out.
    pub inverted: usize,
    /// The largest displacement of a node from rest, m.
    pub deformed: f64,
    /// Flags of the step's wrench.
    pub flags: Flags,
}

/// Follows a simulation step by step.
pub struct Observer {
    body: SoftBody,
    /// Of each tetrahedron, followed from step to step: where it is inside out there are several, and the last one leads.
    rotations: Vec<DQuat>,
    /// Of the tool's own rows, the square of the right-hand side over the diagonal: the solver stops by the size of all rows.
    tool_rhs2: f64,
    /// The largest impulse on the tool so far, N s.
    largest: f64,
    gravity: DVec3,
    dt: f64,
    /// Of the last step's right-hand side, the size: it left some of it, which this one makes good. `None`: unknown, it
    /// touched.
    last_size: Option<f64>,
    tool_leftover: DVec3,
    velocity: Vec<DVec3>,
    tool: Option<(DVec3, DVec3)>,
    device: Option<(DVec3, DQuat)>,
    /// Side and vertex of what touches.
    touching: HashSet<(u32, u32)>,
    /// The most that each vertex that ever touched could press, J.
    pressed: HashMap<(u32, u32), f64>,
    start: Option<DVec3>,
    tool_start: DVec3,
    supplied: f64,
    edge: f64,
}

impl Observer {
    /// Of the first body of a scene, as it is now.
    pub fn new(simulation: &Simulation, scene: &Scene, edge: f64) -> Result<Observer> {
        let placed = &simulation.bodies()[0];
        let Shape::Soft { layer, materials, .. } = &placed.shape else {
            return Err(crate::Error::Simulation("the matrix follows soft bodies".into()));
        };
        let body = SoftBody::new(layer.clone(), materials, placed.position, placed.orientation, placed.velocity);
        let tool = simulation.tool();
        let mut observer = Observer {
            rotations: vec![DQuat::IDENTITY; layer.tetrahedra.len()],
            largest: 0.0,
            tool_rhs2: 0.0,
            last_size: Some(0.0),
            tool_leftover: DVec3::ZERO,
            velocity: Vec::new(),
            body,
            gravity: scene.step.gravity,
            dt: scene.step.dt,
            tool: tool.map(|t| (t.centre, t.velocity)),
            tool_start: tool.map_or(DVec3::ZERO, |t| t.centre),
            device: tool.map(|t| (t.centre, t.orientation)),
            touching: HashSet::new(),
            pressed: HashMap::new(),
            start: None,
            supplied: 0.0,
            edge,
        };
        observer.read(simulation)?;
        observer.start = Some(observer.centre());
        Ok(observer)
    }

    /// The body as it is.
    pub fn body(&self) -> &SoftBody {
        &self.body
    }

    fn read(&mut self, simulation: &Simulation) -> Result<()> {
        if let Some((displacement, velocity)) = simulation.nodes(0)? {
            (self.body.displacement, self.body.velocity) = (displacement, velocity);
            for (e, q) in self.rotations.iter_mut().enumerate() {
                let gradient = self.body.elements.gradient(e, &self.body.displacement);
                *q = followed(DMat3::IDENTITY + gradient, *q);
            }
        }
        Ok(())
    }

    fn free(&self) -> impl Iterator<Item = usize> + '_ {
        self.body.layer.bound.iter().enumerate().filter(|(_, bound)| !**bound).map(|(i, _)| i)
    }

    fn centre(&self) -> DVec3 {
        let (mut sum, mut mass) = (DVec3::ZERO, 0.0);
        for i in self.free() {
            sum += self.body.elements.masses[i] * self.body.displacement[i];
            mass += self.body.elements.masses[i];
        }
        if mass > 0.0 { sum / mass } else { DVec3::ZERO }
    }

    /// The state before the first step.
    pub fn at_start(&self, simulation: &Simulation) -> Sample {
        let mut sample = Sample { is_finite: true, ..Sample::default() };
        self.energies(simulation, &mut sample);
        sample
    }

    /// Does a step and measures it.
    pub fn step(&mut self, simulation: &mut Simulation) -> Result<Sample> {
        let before = Before::of(&self.body, &self.rotations);
        self.velocity.clone_from(&self.body.velocity);
        let row = simulation.step()?;
        self.read(simulation)?;
        let mut sample = Sample { flags: row.flags, ..Sample::default() };
        let nodes = self.body.displacement.iter().chain(&self.body.velocity);
        sample.is_finite = nodes.into_iter().all(|x| x.is_finite())
            && row.residual.is_finite()
            && row.tool.is_none_or(|t| t.force.is_finite() && t.torque.is_finite() && t.tool.position.is_finite());
        if !sample.is_finite {
            return Ok(sample);
        }
        let touch = simulation.touch()?.1;
        self.contacts(&touch);
        self.tool_laws(simulation, &row, &touch, &mut sample);
        let last = self.last_size.take();
        if touch.is_empty() && !row.flags.contains(Flags::STEP_RETRIED) {
            self.last_size = Some(self.equations(&before, last, &mut sample));
        }
        self.energies(simulation, &mut sample);
        Ok(sample)
    }

    /// A contact that is found inside brings energy with it: what it can press beyond all that it had pressed before. One
    /// that comes and goes brings it once.
    fn contacts(&mut self, touch: &[crate::stages::types::Contact]) {
        let stiffest = touch.iter().map(|c| c.stiffness).fold(0.0, f32::max);
        let mut now = HashSet::new();
        for contact in touch {
            let key = (contact.side, contact.vertex);
            let energy = 0.5 * f64::from(stiffest * contact.area) * f64::from(contact.depth).powi(2);
            let most = self.pressed.entry(key).or_default();
            if !self.touching.contains(&key) {
                self.supplied += (energy - *most).max(0.0);
            }
            *most = most.max(energy);
            now.insert(key);
        }
        self.touching = now;
    }

    fn tool_laws(
        &mut self,
        simulation: &Simulation,
        row: &crate::report::Row,
        touch: &[crate::stages::types::Contact],
        sample: &mut Sample,
    ) {
        let (Some(tool), Some(told), Some((_, velocity))) = (simulation.tool(), row.tool, self.tool) else { return };
        let (h, device) = (self.dt, told.device);
        let (last_place, last_turn) = self.device.unwrap_or((device.position, device.orientation));
        let state = crate::haptics::RigidState {
            position: device.position,
            orientation: device.orientation,
            velocity: (device.position - last_place) / h,
            angular_velocity: crate::haptics::drive::rotation_vector(device.orientation * last_turn.conjugate()) / h,
        };
        let pull = tool.pull(&state);
        self.supplied += h * (pull.force.dot(state.velocity) + pull.torque.dot(state.angular_velocity));
        let weight = tool.mass * self.gravity;
        // Without contact the rows are diagonal, but for those that turn.
        let rows = tool.mass + tool.coupling.map_or(0.0, |c| h * (h * c.stiffness + c.damping));
        self.tool_rhs2 = rows * (tool.velocity - velocity).length_squared();
        let change = tool.mass * (tool.velocity - velocity);
        let missed = h * (told.force + weight + pull.force) - change + self.tool_leftover;
        let sizes = [change, h * told.force, h * weight, h * pull.force].map(|x| x.length());
        // Of the largest so far: when all is over, what is left is rounding.
        self.largest = sizes.into_iter().fold(self.largest, f64::max);
        sample.balance = if self.largest > 0.0 { missed.length() / self.largest } else { 0.0 };
        self.tool_leftover = missed;
        self.device = Some((device.position, device.orientation));
        self.tool = Some((tool.centre, tool.velocity));
        sample.force = told.force.length();
        // All that can lie under the sphere, seen from both sides, at the greatest depth and closing as fast as anything moves.
        let area = 2.0 * std::f64::consts::PI * (RADIUS * self.edge).powi(2);
        let stiffness = touch.iter().map(|c| f64::from(c.stiffness)).fold(0.0, f64::max);
        let damping = touch.iter().map(|c| f64::from(c.damping)).fold(0.0, f64::max);
        let depth = row.max_depth.unwrap_or(0.0);
        let nodes = self.velocity.iter().chain(&self.body.velocity).map(|v| v.length()).fold(0.0, f64::max);
        let speed = nodes + velocity.length().max(tool.velocity.length());
        sample.force_bound = area * (stiffness * depth + (h * stiffness + damping) * speed);
    }

    /// b - A x of the step, of the sizes of b in it and in the last one, by the diagonal of A; gives the former. Both steps
    /// leave their share; to carry it along would add up what f32 rounds the same way in every step of a body at rest.
    fn equations(&self, before: &Before, last: Option<f64>, sample: &mut Sample) -> f64 {
        let (h, elements) = (self.dt, &before.body.elements);
        let (start, end) = (&self.velocity, &self.body.velocity);
        let stiff = |p: &[DVec3]| elements.apply_weighted(p, &before.rotations, |m| h * (h + m.damping_stiffness));
        let (of_end, of_start) = (stiff(end), stiff(start));
        let forces = elements.forces(&before.body.displacement, &before.rotations);
        let (mut left2, mut rhs2, mut floor2) = (0.0, self.tool_rhs2, 0.0);
        let sizes = before.sizes(h, start, end);
        for i in 0..start.len() {
            if self.body.layer.bound[i] {
                continue;
            }
            let (mass, damping) = (elements.masses[i], elements.damping[i]);
            let rhs = h * forces[i] + h * mass * self.gravity - h * damping * start[i] - of_start[i];
            let image = (mass + h * damping) * (end[i] - start[i]) + of_end[i] - of_start[i];
            let diagonal = mass + h * damping + sizes[i].0;
            let floor = sizes[i].1
                + mass * (start[i].length() + end[i].length() + h * self.gravity.length())
                + h * damping * (start[i].length() + end[i].length());
            left2 += (rhs - image).length_squared() / diagonal;
            // Where forces cancel, weight tells how large they are.
            rhs2 += (rhs.length_squared() + (h * mass * self.gravity).length_squared()) / diagonal;
            floor2 += (ROUNDINGS * HALF_ULP * floor).powi(2) / diagonal;
        }
        let size = f64::sqrt(rhs2);
        if let Some(all) = last.map(|last| size + last).filter(|all| *all > 0.0) {
            (sample.residual, sample.residual_floor) = (f64::sqrt(left2) / all, f64::sqrt(floor2) / all);
        }
        size
    }

    fn energies(&self, simulation: &Simulation, sample: &mut Sample) {
        let elements = &self.body.elements;
        let (mut kinetic, mut weight) = (0.0, 0.0);
        for i in self.free() {
            kinetic += 0.5 * elements.masses[i] * self.body.velocity[i].length_squared();
            weight -= elements.masses[i] * self.gravity.dot(elements.frame * self.body.displacement[i]);
        }
        let elastic = elements.energy(&self.body.displacement, &self.rotations);
        let mut coupling = 0.0;
        if let Some(tool) = simulation.tool() {
            let (position, orientation) = self.device.unwrap_or((tool.centre, tool.orientation));
            let (velocity, angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
            let device = crate::haptics::RigidState { position, orientation, velocity, angular_velocity };
            let moving = tool.mass * 0.5 * tool.velocity.length_squared();
            kinetic += moving;
            coupling = tool.stored(&device) - moving;
            weight -= tool.mass * self.gravity.dot(tool.centre - self.tool_start);
        }
        sample.energy = kinetic + weight + elastic + coupling;
        sample.kinetic = kinetic;
        sample.supplied = self.supplied;
        sample.turned_over = kinetic + weight.abs() + elastic + coupling + self.supplied.abs();
        sample.moved = self.start.map_or(DVec3::ZERO, |start| self.centre() - start);
        sample.deformed = self.body.displacement.iter().map(|d| d.length()).fold(0.0, f64::max);
        let turned_out =
            |e: &usize| (DMat3::IDENTITY + elements.gradient(*e, &self.body.displacement)).determinant() <= 0.0;
        sample.inverted = (0..elements.tetrahedra.len()).filter(turned_out).count();
    }
}

/// The body at the start of a step, linearised there.
struct Before {
    body: SoftBody,
    rotations: Vec<DQuat>,
}

impl Before {
    fn of(body: &SoftBody, rotations: &[DQuat]) -> Before {
        let rotations = rotations.to_vec();
        let mut body = body.clone();
        body.elements = body.elements.linearised(&body.displacement, &rotations);
        Before { body, rotations }
    }

    /// At each node: the stiffness on the diagonal (kg), and the sizes of what its elements add up (N s).
    fn sizes(&self, h: f64, start: &[DVec3], end: &[DVec3]) -> Vec<(f64, f64)> {
        let elements = &self.body.elements;
        let mut sizes = vec![(0.0, 0.0); start.len()];
        let spread = |nodes: &[u32; 4], of: &[DVec3]| {
            nodes.iter().map(|i| of[*i as usize].distance(of[nodes[0] as usize])).fold(0.0, f64::max)
        };
        // A velocity is rounded as a whole, whatever of it its element feels.
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
                // A node has a third to all of the steepest gradient; a half stands for it.
                *at = (at.0 + 0.5 * lag, at.1 + size);
            }
        }
        sizes
    }
}

/// Rounds at most, and the turn that is none, rad.
const ROUNDS: usize = 200;
const DONE: f64 = 1e-12;

/// The rotation of F that is reached from the last one (Mueller et al. 2016).
fn followed(f: DMat3, from: DQuat) -> DQuat {
    let mut q = from;
    for _ in 0..ROUNDS {
        let r = DMat3::from_quat(q);
        let (mut axial, mut trace) = (DVec3::ZERO, 0.0);
        for k in 0..3 {
            axial += r.col(k).cross(f.col(k));
            trace += r.col(k).dot(f.col(k));
        }
        let turn = axial / (trace.abs() + 1e-12);
        if !turn.is_finite() || turn.length() < DONE {
            break;
        }
        q = (DQuat::from_scaled_axis(turn) * q).normalize();
    }
    q
}
