//! What the simulation's thread publishes: a snapshot of the newest state, which replaces the previous snapshot; a
//! sample (time and forces) of each step; and lines for the user. A *session* is one run of the haptic loop, in
//! which a haptic device holds the *tool*, a rigid body of the simulation.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Sender;

use glam::DVec3;
use palpate::internal::haptics::session::Report;
use palpate::internal::shaders::MOST_TOOLS;
use palpate::scene::{Contact, Coupling, Material};
use palpate::{Simulation, StepReport, Wrench};

use super::super::materials::region_name;

/// What the thread is doing.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum State {
    /// The thread steps the simulation.
    #[default]
    Running,
    /// The thread waits for a command to go on.
    Paused,
    /// The thread steps the simulation, and the session is recorded into this file.
    Recording(PathBuf),
    /// A step failed for this reason, and the thread waits for a command.
    Failed(String),
    /// The thread has done all steps, or the session's time is over; the thread waits for a command.
    Ended,
}

/// The quantities that the user can change, with their present values.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Names of the tools, in the scene's order.
    pub tools: Vec<String>,
    /// For each material: index of the body, index among the body's materials, name for the user, and the material.
    pub materials: Vec<(usize, usize, String, Material)>,
    /// The contact law.
    pub contact: Option<Contact>,
    /// Contact stiffness of the stiffest pair of bodies, N/m^3; the window shows it where the scene says "auto".
    pub stiffness: f64,
    /// The virtual coupling (spring and damper between device and tool) that was asked for, of several tools the first's.
    pub coupling: Option<Coupling>,
    /// Whether devices hold the tools; then the haptic loops limit the gains of the couplings.
    pub has_device: bool,
}

/// Recent state of the haptic loop.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoopState {
    /// Number of ticks (iterations of the loop) in the session.
    pub ticks: u64,
    /// How late ticks came: the median, the 99th percentile and the worst of the session, s.
    pub late: [f64; 3],
    /// The wrench (force and torque) that was commanded to the device last.
    pub played: Wrench,
    /// Names of the unusual events in the haptic loop since the previous step.
    pub events: Vec<&'static str>,
}

/// The newest state of the simulation.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// Number of the simulation; another number means that the simulation or its arrays were replaced.
    pub generation: u64,
    /// What the thread is doing.
    pub state: State,
    /// Report of the last step.
    pub row: Option<StepReport>,
    /// Names of the probes (points of skins whose paths are recorded) in the step report.
    pub probes: Arc<Vec<String>>,
    /// Names of the stages of the last step that was timed, each with its time, microseconds.
    pub stages: Vec<(String, f64)>,
    /// State of the haptic loop of each tool that a device holds, in the scene's order.
    pub haptics: Vec<LoopState>,
    /// The quantities that the user can change.
    pub settings: Arc<Settings>,
}

/// Values of one step, for the force plot in the window of `palpate view`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Simulated time, s.
    pub time: f64,
    /// Contact force on each tool, N; zero for tools that the scene does not have.
    pub forces: [DVec3; MOST_TOOLS as usize],
}

/// The sending ends of the channels through which the thread publishes.
pub(super) struct Out {
    pub out: triple_buffer::Input<Snapshot>,
    pub samples: rtrb::Producer<Sample>,
    pub notes: Sender<String>,
    /// Takes the reports of each session that ended, one for each device.
    pub sessions: Sender<Vec<Report>>,
}

impl Out {
    /// Sends a line to the user.
    pub fn note(&self, line: impl Into<String>) {
        // If the receiver is gone, sending fails, which is ignored.
        let _ = self.notes.send(line.into());
    }

    /// Publishes the sample of a step; the sample is dropped if the queue is full.
    pub fn sample(&mut self, row: &StepReport) {
        let mut forces = [DVec3::ZERO; MOST_TOOLS as usize];
        forces.iter_mut().zip(row.tools()).for_each(|(force, tool)| *force = tool.force);
        if row.tool.is_some() {
            let _ = self.samples.push(Sample { time: row.time, forces });
        }
    }
}

/// The quantities of a simulation that the user can change, with their present values.
pub(super) fn settings(simulation: &Simulation, has_device: bool) -> Settings {
    let scene = simulation.scene();
    let of_body = |(index, body): (usize, &palpate::scene::Body)| {
        let name = body.name.clone();
        let materials = simulation.materials(index).to_vec();
        let named = materials.into_iter().enumerate().map(|(k, material)| {
            let name = if k == 0 { name.clone() } else { format!("{name}, {}", region_name(body, k)) };
            (index, k, name, material)
        });
        named.collect::<Vec<_>>()
    };
    Settings {
        tools: scene.tool_names().map(String::from).collect(),
        materials: scene.bodies.iter().enumerate().flat_map(of_body).collect(),
        contact: Some(scene.contact.clone()),
        stiffness: simulation.contact_stiffness(),
        coupling: if simulation.tool().is_some() { scene.coupling } else { None },
        has_device,
    }
}
