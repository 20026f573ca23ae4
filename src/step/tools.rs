//! Makes the tools (what haptic devices lead) of a scene. A single tool is either a rigid body of its own, or a held
//! core; of several tools each is a held core. A core is a rigid body inside a soft body, to which nodes are attached, or
//! a dynamic rigid body itself; a held core is one to which a haptic device is coupled.

use glam::{DMat3, DQuat, DVec3};

use super::frames::Frames;
use crate::prepare::{Body, Shape};
use crate::scene::{self, Coupling, Key, Scene};
use crate::shaders::{HeldCore, Report, ToolWrench};
use crate::stages::model::Model;
use crate::step::tool::Tool;
use crate::step::trajectory::Trajectory;
use crate::step::{ContactWrench, DeviceInput, FARTHER, Flags, Pose, RigidState, ToolReport, Wrench};
use crate::{Error, Result};

/// The tool in its state at the start of the scene. `body` is the prepared rigid body of the tool, if it has one of its
/// own.
pub(super) fn tool_of(scene: &Scene, body: Option<&Body>, model: &Model, frames: &Frames) -> Result<Option<Tool>> {
    let Some(spec) = &scene.tool else { return Ok(None) };
    let problem = "the body's first core is not dynamic";
    let missing =
        || Error::key(&scene.file, "tool.body", problem, "make it \"dynamic\": the haptic device is coupled to it");
    match body {
        Some(body) => Ok(Some(rigid(scene, spec.mass, body))),
        None => Ok(Some(held(scene.coupling, model, model.tool_core().ok_or_else(missing)?, frames))),
    }
}

/// A tool after the first of several, each of which is a held core.
#[derive(Debug, Clone)]
pub struct HeldTool {
    /// The held core as a tool.
    pub tool: Tool,
    /// Index of the core among the dynamic cores.
    core: usize,
    /// Where its haptic device goes.
    pub trajectory: Trajectory,
    /// Its coupling outside of a haptic loop, which sets its own.
    coupling: Option<Coupling>,
    /// Whether the tool has weight; in a haptic loop its weight is compensated.
    has_weight: bool,
    /// Mass of the whole body that the core is part of, kg.
    body_mass: f64,
    /// Greatest force of the virtual coupling's spring, N.
    max_force: f64,
    /// The contact wrench on the tool in the last step, if it is one that the haptic loop asked for.
    pub wrench: Option<ContactWrench>,
}

impl HeldTool {
    /// The tools of a scene after the first, in their states at the start.
    pub fn all_of(scene: &Scene, model: &Model, frames: &Frames) -> Result<Vec<HeldTool>> {
        let missing = |name: &str| {
            let key = format!("tool.{name}.body");
            Error::key(&scene.file, key, "the body's first core is not dynamic", "make it \"dynamic\"")
        };
        let make = |(k, spec): (usize, &scene::FurtherTool)| {
            let core = *model.tool_cores.get(k + 1).ok_or_else(|| missing(&spec.name))?;
            let tool = held(spec.coupling, model, core, frames);
            let start = Key { time: 0.0, position: tool.centre, orientation: tool.orientation };
            let trajectory = Trajectory::new(&spec.trajectory, start);
            let body_mass = body_mass(model, core);
            let (coupling, max_force) = (tool.coupling, f64::INFINITY);
            Ok(HeldTool { tool, core, trajectory, coupling, has_weight: true, body_mass, max_force, wrench: None })
        };
        scene.further_tools.iter().enumerate().map(make).collect()
    }

    /// Sets pose and twist to those of the held core.
    pub fn follow(&mut self, model: &Model, frames: &Frames) {
        follow(&mut self.tool, frames, model.cores[self.core].frame);
    }

    /// Has the haptic loop lead the tool from now on: the device rests at the pose that `input` gives it at `time`, s.
    pub fn follow_loop(&mut self, input: &DeviceInput, time: f64) {
        let RigidState { position, orientation, .. } = input.device;
        self.trajectory = Trajectory::new(&[], Key { time, position, orientation });
        self.tool.coupling = input.coupling;
        (self.has_weight, self.max_force) = (false, input.max_force);
    }

    /// Ends what [`HeldTool::follow_loop`] began; the device stays where it is.
    pub fn leave_loop(&mut self) {
        self.tool.coupling = self.coupling;
        (self.has_weight, self.max_force, self.wrench) = (true, f64::INFINITY, None);
    }

    /// Takes the contact wrench from the GPU's report of a step, if the haptic loop leads the tool, which has this index
    /// among the further ones.
    pub fn feel(&mut self, index: usize, step: u64, report: &Report, friction: f64) {
        self.wrench = (!self.has_weight).then(|| contact_wrench(&self.tool, index + 1, step, report, friction));
    }

    /// Takes mass and inertia again from a model of the same bodies with other densities.
    pub fn weigh(&mut self, model: &Model, frames: &Frames) {
        let Tool { mass, inertia, .. } = held(self.coupling, model, self.core, frames);
        (self.tool.mass, self.tool.inertia) = (mass, inertia);
        self.body_mass = body_mass(model, self.core);
    }

    /// What the solver reads in a step of `h` seconds that ends at `time`, s; `origin`: world position to which positions
    /// on the GPU are relative, m.
    pub fn held_core(&self, time: f64, h: f64, gravity: DVec3, origin: DVec3) -> HeldCore {
        let device = self.tool.within_reach(&self.trajectory.device(time, h), self.max_force);
        let carried = if self.has_weight { DVec3::ZERO } else { h * self.body_mass * gravity };
        held_core(&self.tool, self.core, &device, carried, h, origin)
    }

    /// The tool at the end of a step of `h` seconds that ended at `time`, s, with the forces that the GPU reports for the
    /// tool of this index among the further ones.
    pub fn report(&self, time: f64, h: f64, report: &Report, index: usize) -> ToolReport {
        tool_report(&self.tool, &self.trajectory.device(time, h), &report.tools[index + 1])
    }
}

/// The tool at the end of a step, with the state of its haptic device and with what the GPU reports for it.
pub(super) fn tool_report(tool: &Tool, device: &RigidState, felt: &ToolWrench) -> ToolReport {
    ToolReport {
        tool: Pose { position: tool.centre, orientation: tool.orientation },
        device: Pose { position: device.position, orientation: device.orientation },
        force: vector(felt.force),
        torque: vector(felt.torque),
    }
}

fn vector(x: [f32; 3]) -> DVec3 {
    DVec3::from(x.map(f64::from))
}

/// What the solver reads of a held core in a step of `h` seconds: the rows of its virtual coupling to the haptic device,
/// whose hand carries the impulse of weight `carried`, N s.
pub(super) fn held_core(
    tool: &Tool,
    core: usize,
    device: &RigidState,
    carried: DVec3,
    h: f64,
    origin: DVec3,
) -> HeldCore {
    let mut rows = tool.coupling_rows(h, device);
    (0..3).for_each(|k| rows.rhs[k] -= carried[k]);
    HeldCore {
        core: core as u32,
        matrix: std::array::from_fn(|k| rows.matrix[k / 6][k % 6] as f32),
        rhs: rows.rhs.map(|x| x as f32),
        centre: (tool.centre - origin).as_vec3().to_array(),
    }
}

/// A tool with a rigid body of its own. Its inertia is that of a solid of uniform density within the body's surface.
fn rigid(scene: &Scene, mass: f64, body: &Body) -> Tool {
    let inertia = match &body.shape {
        Shape::Rigid { volume, inertia, .. } => *inertia * (mass / volume),
        _ => DMat3::IDENTITY,
    };
    Tool {
        mass,
        inertia,
        coupling: scene.coupling,
        centre: body.position,
        orientation: body.orientation,
        velocity: body.velocity,
        angular_velocity: DVec3::ZERO,
    }
}

/// The held core as a tool; its mass and inertia are those of the nodes attached to the core.
fn held(coupling: Option<Coupling>, model: &Model, core: usize, frames: &Frames) -> Tool {
    let core = &model.cores[core];
    let mut tool = Tool {
        mass: core.nodes.iter().map(|n| f64::from(model.node_rest[*n as usize][3])).sum(),
        inertia: model.inertia_of(core),
        coupling,
        centre: DVec3::ZERO,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    };
    follow(&mut tool, frames, core.frame);
    tool
}

/// Mass of the whole soft body that the first tool is part of, kg; 0 where that is no core of a body.
pub(super) fn tool_core_mass(model: &Model) -> f64 {
    model.tool_core().map_or(0.0, |core| body_mass(model, core))
}

/// Mass of the whole soft body that a core is part of, or of the core itself if it is a rigid body, kg.
fn body_mass(model: &Model, core: usize) -> f64 {
    let core = &model.cores[core];
    let mass = |node: usize| f64::from(model.node_rest[node][3]);
    let holds = |nodes: &std::ops::Range<usize>| core.nodes.iter().any(|n| nodes.contains(&(*n as usize)));
    match model.soft.iter().find(|soft| holds(&soft.nodes)) {
        Some(soft) => soft.nodes.clone().map(mass).sum(),
        None => core.nodes.iter().map(|n| mass(*n as usize)).sum(),
    }
}

/// Sets pose and twist (linear and angular velocity) of a tool that is a held core to those of the core's rigid
/// coordinate frame.
pub(super) fn follow(tool: &mut Tool, frames: &Frames, frame: usize) {
    let place = frames.place(frame);
    (tool.centre, tool.orientation) = (place.centre, place.rotation);
    if let Some((linear, angular)) = frames.twist(frame) {
        (tool.velocity, tool.angular_velocity) = (linear, angular);
    }
}

/// The contact wrench (force and torque) on the tool of this index, as the GPU reports it after a step.
pub(super) fn contact_wrench(tool: &Tool, index: usize, step: u64, report: &Report, friction: f64) -> ContactWrench {
    let felt = &report.tools[index];
    // No forces were applied in a frozen step: every attempt at it failed, and the bodies were stopped where they are.
    let is_frozen = Flags(report.flags).contains(Flags::FROZEN);
    let matrix = |upper: &[f32; 21]| if is_frozen { [[0.0; 6]; 6] } else { symmetric(upper) };
    ContactWrench {
        step,
        time: 0.0,
        h: 0.0,
        tool: tool.state(),
        wrench: Wrench { force: vector(felt.force), torque: vector(felt.torque) },
        stiffness: matrix(&felt.stiffness),
        damping: matrix(&felt.damping),
        pressing: felt.pressing.into(),
        friction: vector(felt.friction),
        most_friction: friction * f64::from(felt.pressing),
        gap: None,
        farther: [None; FARTHER],
        has_kinematic_motion: false,
    }
}

/// The symmetric matrix whose upper triangle is given row by row.
fn symmetric(upper: &[f32; 21]) -> [[f64; 6]; 6] {
    let mut matrix = [[0.0; 6]; 6];
    let pairs = (0..6).flat_map(|i| (i..6).map(move |k| (i, k)));
    for ((i, k), x) in pairs.zip(upper) {
        (matrix[i][k], matrix[k][i]) = (f64::from(*x), f64::from(*x));
    }
    matrix
}
