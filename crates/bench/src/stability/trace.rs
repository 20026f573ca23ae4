//! Measures a step of the stability matrix (many stiff and extreme simulations, each judged by invariants) from outside
//! the engine in f64: energies, work, and the residuals of the equations of motion. It shares no code with the shaders.
//! The tool is the rigid body that the haptic device leads by a virtual coupling (spring and damper); the wrench is the
//! force and torque of the contacts on the tool.

use std::collections::{HashMap, HashSet};

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::shaders::Contact;
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::rotation_vector;
use palpate::{Flags, Result, RigidState, Scene, Simulation, ToolReport};
use palpate_oracle::step::SoftBody;

use super::equations::{Before, Done};
use super::joined::joined;
use super::setup::RADIUS;
use super::touch::{self, Motion, Skin};

/// Half a unit in the last place of an f32 near 1; relative error of one rounding.
pub const HALF_ULP: f64 = 6e-8;
/// Number of roundings that a sum over the elements or contacts of a node may accumulate.
pub const ROUNDINGS: f64 = 16.0;

/// Measurements of the state after one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Whether all numbers that the step reports are finite.
    pub is_finite: bool,
    /// Sum of kinetic energy, elastic energy, gravitational energy (relative to the start) and energy of the virtual
    /// coupling, J.
    pub energy: f64,
    /// Energy supplied since the start, J: work of the haptic device, and energy of contacts that were already deep
    /// when they were found.
    pub supplied: f64,
    /// Sum of the magnitudes of the terms of `energy` and of `supplied`, which bounds their rounding, J.
    pub turned_over: f64,
    /// Kinetic energy of the body, and of the tool's translation if it has a coupling, J; it must vanish in a case
    /// (one simulation of the matrix) that comes to rest.
    pub motion: f64,
    /// `motion` plus the body's elastic energy, J.
    pub stirred: f64,
    /// Greatest sum of elastic force and weight on a free node, over the weight of all free nodes; zero without
    /// gravity.
    pub unbalanced: f64,
    /// Residual of the step's linear system in the norm of its diagonal, relative to the sum of the norms of the
    /// right-hand sides of this step and of the step before. It includes the residual that the step before left.
    pub residual: f64,
    /// The part of `residual` that f32 rounding alone may cause.
    pub residual_floor: f64,
    /// Difference of the tool's change of momentum from the impulses of contact force, weight and coupling, over the
    /// largest impulse so far.
    pub balance: f64,
    /// Magnitude of the contact force on the tool, N.
    pub force: f64,
    /// Sum of the magnitudes of all contacts' pushes, N.
    pub pressed: f64,
    /// Difference between the wrench that the step reports and the sum of its contacts' forces and torques: the
    /// difference of the forces plus that of the torques over the tool's radius, N.
    pub missed: f64,
    /// Largest pull of a contact, N.
    pub tension: f64,
    /// Error that f32 rounding may cause in the sum of the contacts' forces, N.
    pub touch_floor: f64,
    /// Displacement of the centre of mass of the free nodes since the start, m.
    pub moved: DVec3,
    /// Number of tetrahedra that are inside out.
    pub inverted: usize,
    /// Largest displacement of a node from rest, m.
    pub deformed: f64,
    /// Flags of the step, the engine's reports of problems in it.
    pub flags: Flags,
}

/// Follows a simulation step by step and measures it.
pub struct Observer {
    /// All soft bodies, joined.
    body: SoftBody,
    /// For each soft body its number of nodes.
    nodes: Vec<usize>,
    /// Polar rotation of each tetrahedron, followed from step to step: an inverted tetrahedron has several polar
    /// rotations, of which the one nearest to that of the last step is taken.
    rotations: Vec<DQuat>,
    skin: Skin,
    /// Largest impulse on the tool so far, N s.
    largest: f64,
    gravity: DVec3,
    dt: f64,
    newton: u32,
    /// Norm of the right-hand side of the last step, whose remaining residual is part of this step's residual. `None`:
    /// unknown, since the last step was retried in parts.
    last_size: Option<f64>,
    /// Error of the tool's balance of momentum in the last step, N s; the next step compensates for it.
    tool_carried_residual: DVec3,
    tool: Option<Tool>,
    device: Option<(DVec3, DQuat)>,
    /// Contacts of the last step, by side (twice the index of the pair of bodies, plus 1 for its second body) and by
    /// the vertex or triangle that is tested.
    touching: HashSet<(u32, u32)>,
    /// Greatest energy that the contact of each vertex or triangle has had, J, by side and index as in `touching`.
    pressed: HashMap<(u32, u32), f64>,
    start: Option<DVec3>,
    tool_start: DVec3,
    supplied: f64,
    edge: f64,
}

impl Observer {
    /// Observes the soft bodies of a scene, which come first in it, beginning with their present state. Errors: the
    /// first body is not soft.
    pub fn new(simulation: &Simulation, scene: &Scene, edge: f64) -> Result<Observer> {
        let first = &simulation.bodies()[0];
        let all = joined(simulation.bodies())?;
        let skin = Skin::new(&all, simulation.bodies(), scene)?;
        let (position, orientation) = (first.position, first.orientation);
        let body =
            SoftBody::new(all.layer, all.materials, position, orientation, first.velocity).supported(&all.supports);
        let tool = simulation.tool();
        let mut observer = Observer {
            rotations: vec![DQuat::IDENTITY; body.layer.tetrahedra.len()],
            largest: 0.0,
            skin,
            nodes: all.nodes,
            last_size: Some(0.0),
            tool_carried_residual: DVec3::ZERO,
            body,
            gravity: scene.step.gravity,
            dt: scene.step.dt,
            newton: scene.step.newton,
            tool: tool.cloned(),
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

    /// The bodies in their present state, joined.
    pub fn body(&self) -> &SoftBody {
        &self.body
    }

    fn read(&mut self, simulation: &Simulation) -> Result<()> {
        let mut first = 0;
        for (body, count) in self.nodes.iter().enumerate() {
            if let Some((displacement, velocity)) = simulation.nodes(body)? {
                self.body.displacement[first..first + count].copy_from_slice(&displacement);
                self.body.velocity[first..first + count].copy_from_slice(&velocity);
            }
            first += count;
        }
        for (e, q) in self.rotations.iter_mut().enumerate() {
            let gradient = self.body.elements.gradient(e, &self.body.displacement);
            *q = followed(DMat3::IDENTITY + gradient, *q);
        }
        Ok(())
    }

    fn free(&self) -> impl Iterator<Item = usize> + '_ {
        self.body.layer.attached.iter().enumerate().filter(|(_, bound)| !**bound).map(|(i, _)| i)
    }

    fn centre(&self) -> DVec3 {
        let (mut sum, mut mass) = (DVec3::ZERO, 0.0);
        for i in self.free() {
            sum += self.body.elements.masses[i] * self.body.displacement[i];
            mass += self.body.elements.masses[i];
        }
        if mass > 0.0 { sum / mass } else { DVec3::ZERO }
    }

    /// Measurements of the state before the first step.
    pub fn at_start(&self) -> Sample {
        let mut sample = Sample { is_finite: true, ..Sample::default() };
        self.energies(&mut sample);
        sample
    }

    /// Does a step of the simulation and measures it.
    pub fn step(&mut self, simulation: &mut Simulation) -> Result<Sample> {
        let before = Before::of(&self.body, &self.rotations, self.tool.as_ref());
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
        let contacts = simulation.touch()?.1;
        self.found(&contacts);
        let device = row.tool.map(|told| self.device_now(&told));
        if let (Some(tool), Some(told), Some(device)) = (simulation.tool(), row.tool, device) {
            self.balance(tool, &told, &device, &mut sample);
            if row.parts > 1 {
                // The forces of the last part alone are known.
                (sample.balance, self.tool_carried_residual) = (0.0, DVec3::ZERO);
            }
        }
        let last = self.last_size.take();
        // A step that was done in parts, or retried in parts, reports its last part only, so that its linear system
        // cannot be checked; nor can that of the last of several Newton iterations, which is linearised elsewhere than
        // at the step's start.
        if !row.flags.contains(Flags::STEP_RETRIED) && row.parts == 1 && self.newton == 1 {
            let pressing = self.skin.pressing(&contacts);
            let tool = simulation.tool().zip(device);
            self.touching_invariants(&pressing, tool, row.tool.as_ref(), &mut sample);
            let (h, gravity) = (self.dt, self.gravity);
            let done = Done { h, gravity, end: &self.body.velocity, tool, contacts: &pressing };
            let left = before.left(&done);
            // The residual includes the share that the last step left, which is not subtracted: f32 rounds in the same
            // way in every step of a body at rest, and subtracting would add up these errors over many steps.
            let size = left.size2.sqrt();
            if let Some(all) = last.map(|last| size + last).filter(|all| *all > 0.0) {
                (sample.residual, sample.residual_floor) = (left.left2.sqrt() / all, left.floor2.sqrt() / all);
            }
            self.last_size = Some(size);
        }
        self.device = device.map(|device| (device.position, device.orientation));
        self.tool = simulation.tool().cloned();
        self.energies(&mut sample);
        Ok(sample)
    }

    /// Compares the reported wrench with the sum of the contacts' forces, and enters the result into `sample`.
    fn touching_invariants(
        &self,
        pressing: &[touch::Pressing],
        tool: Option<(&Tool, RigidState)>,
        told: Option<&ToolReport>,
        sample: &mut Sample,
    ) {
        let (linear, angular) =
            tool.map_or((DVec3::ZERO, DVec3::ZERO), |(tool, _)| (tool.velocity, tool.angular_velocity));
        let motion = Motion { nodes: &self.body.velocity, linear, angular };
        let held = touch::held(pressing, self.dt, &motion, told, RADIUS * self.edge);
        (sample.pressed, sample.tension) = (held.pressed, held.tension.max(0.0));
        (sample.missed, sample.touch_floor) = (held.missed, held.rounding);
    }

    /// The haptic device at the end of the step; within the step it moves at constant velocity.
    fn device_now(&self, told: &ToolReport) -> RigidState {
        let (position, orientation) = (told.device.position, told.device.orientation);
        let (last_place, last_turn) = self.device.unwrap_or((position, orientation));
        RigidState {
            position,
            orientation,
            velocity: (position - last_place) / self.dt,
            angular_velocity: rotation_vector(orientation * last_turn.conjugate()) / self.dt,
        }
    }

    /// Adds the energy of newly found contacts to the energy supplied. A contact that is already deep adds the energy
    /// of its penalty spring as far as that exceeds the greatest energy of earlier contacts of the same vertex
    /// or triangle, so that a contact that comes and goes adds its energy once.
    fn found(&mut self, touch: &[Contact]) {
        let stiffest = touch.iter().map(|c| c.stiffness).fold(0.0, f32::max);
        let mut now = HashSet::new();
        for contact in touch {
            // Several triangles may count as contacts of one vertex of the tool.
            let is_triangle = contact.tool_sign != 0.0 && self.skin.has_triangles_tested();
            let key = (contact.side, if is_triangle { contact.triangle } else { contact.vertex });
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

    /// Compares the tool's change of momentum with the impulses on it, and adds the work of the haptic device to the
    /// energy supplied.
    fn balance(&mut self, tool: &Tool, told: &ToolReport, device: &RigidState, sample: &mut Sample) {
        let h = self.dt;
        let velocity = self.tool.as_ref().map_or(tool.velocity, |before| before.velocity);
        let pull = tool.pull(device);
        self.supplied += h * (pull.force.dot(device.velocity) + pull.torque.dot(device.angular_velocity));
        let weight = tool.mass * self.gravity;
        let change = tool.mass * (tool.velocity - velocity);
        let missed = h * (told.force + weight + pull.force) - change + self.tool_carried_residual;
        let sizes = [change, h * told.force, h * weight, h * pull.force].map(|x| x.length());
        // The error is divided by the largest impulse so far, since the present impulses may be mere rounding errors
        // once the motion has ended.
        self.largest = sizes.into_iter().fold(self.largest, f64::max);
        sample.balance = if self.largest > 0.0 { missed.length() / self.largest } else { 0.0 };
        // Contacts that pull move the tool but are left out of its force. That is no residual, and is not made up for.
        let pulled = sample.flags.contains(Flags::TENSION_REMAINS);
        self.tool_carried_residual = if pulled { DVec3::ZERO } else { missed };
        sample.force = told.force.length();
    }

    fn energies(&self, sample: &mut Sample) {
        let elements = &self.body.elements;
        let (mut kinetic, mut weight) = (0.0, 0.0);
        for i in self.free() {
            kinetic += 0.5 * elements.masses[i] * self.body.velocity[i].length_squared();
            weight -= elements.masses[i] * self.gravity.dot(elements.frame * self.body.displacement[i]);
        }
        let elastic = elements.energy(&self.body.displacement, &self.rotations);
        let (mut coupling, mut motion) = (0.0, kinetic);
        if let Some(tool) = &self.tool {
            let (position, orientation) = self.device.unwrap_or((tool.centre, tool.orientation));
            let (velocity, angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
            let device = RigidState { position, orientation, velocity, angular_velocity };
            let moving = tool.mass * 0.5 * tool.velocity.length_squared();
            kinetic += moving;
            motion += if tool.coupling.is_some() { moving } else { 0.0 };
            coupling = tool.stored(&device, f64::INFINITY, true) - moving;
            weight -= tool.mass * self.gravity.dot(tool.centre - self.tool_start);
        }
        let forces = elements.forces(&self.body.displacement, &self.rotations);
        let left = self.free().map(|i| (forces[i] + elements.masses[i] * self.gravity).length()).fold(0.0, f64::max);
        let weight_of_all: f64 = self.free().map(|i| elements.masses[i] * self.gravity.length()).sum();
        sample.unbalanced = if weight_of_all > 0.0 { left / weight_of_all } else { 0.0 };
        sample.energy = kinetic + weight + elastic + coupling;
        (sample.motion, sample.stirred) = (motion, motion + elastic);
        sample.supplied = self.supplied;
        sample.turned_over = kinetic + weight.abs() + elastic + coupling + self.supplied.abs();
        sample.moved = self.start.map_or(DVec3::ZERO, |start| self.centre() - start);
        sample.deformed = self.body.displacement.iter().map(|d| d.length()).fold(0.0, f64::max);
        let turned_out =
            |e: &usize| (DMat3::IDENTITY + elements.gradient(*e, &self.body.displacement)).determinant() <= 0.0;
        sample.inverted = (0..elements.tetrahedra.len()).filter(turned_out).count();
    }
}

/// Greatest number of iterations in [`followed`].
const ROUNDS: usize = 200;
/// The iteration in [`followed`] has converged when it turns by less than this angle, rad.
const DONE: f64 = 1e-12;

/// The polar rotation of the deformation gradient `f` that is nearest to `from`, the rotation after the last step, by
/// the iteration of Mueller et al. (2016).
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
