//! What the simulation's thread publishes: the newest state, which replaces the one before, samples and lines.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Sender;

use glam::DVec3;
use palpate::internal::haptics::session::Report;
use palpate::scene::{Contact, Coupling, Material};
use palpate::{Simulation, StepReport, Wrench};

/// What the thread does.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum State {
    /// Steps.
    #[default]
    Running,
    /// Rests until told to go on.
    Paused,
    /// Steps, and a session is recorded into this file.
    Recording(PathBuf),
    /// A step failed, for this reason; it rests.
    Failed(String),
    /// It went as far as it was to go.
    Ended,
}

/// What can be changed, as it is now.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Body, index among its materials, what it is called, and the material.
    pub materials: Vec<(usize, usize, String, Material)>,
    /// The contact law.
    pub contact: Option<Contact>,
    /// Of the stiffest pair of bodies, N/m^3: what "auto" stands for.
    pub stiffness: f64,
    /// The coupling asked for.
    pub coupling: Option<Coupling>,
    /// Whether the loop chooses what the coupling may be.
    pub is_held: bool,
}

/// The haptic loop lately.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoopState {
    /// Ticks of the session.
    pub ticks: u64,
    /// How late ticks came: the median, the 99th percentile and the worst of the session, s.
    pub late: [f64; 3],
    /// What is played.
    pub played: Wrench,
    /// Names of what happened since the step before.
    pub events: Vec<&'static str>,
}

/// The newest.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// Changes where the simulation is replaced.
    pub generation: u64,
    /// What the thread does.
    pub state: State,
    /// Of the last step.
    pub row: Option<StepReport>,
    /// Names of the row's probes.
    pub probes: Arc<Vec<String>>,
    /// Of the last step that was timed, microseconds.
    pub stages: Vec<(String, f64)>,
    /// Where a device is held.
    pub haptics: Option<LoopState>,
    /// What can be changed.
    pub settings: Arc<Settings>,
}

/// A step, for the traces of the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Of the simulation, s.
    pub time: f64,
    /// On the tool, N.
    pub force: DVec3,
    /// On the tool, N m.
    pub torque: DVec3,
}

/// The thread's ends.
pub(super) struct Out {
    pub out: triple_buffer::Input<Snapshot>,
    pub samples: rtrb::Producer<Sample>,
    pub notes: Sender<String>,
    /// What came of sessions with a device.
    pub sessions: Sender<Report>,
}

impl Out {
    /// Says something to the user.
    pub fn note(&self, line: impl Into<String>) {
        // Who reads may be gone.
        let _ = self.notes.send(line.into());
    }

    /// Publishes a step; the samples that nobody takes are dropped.
    pub fn sample(&mut self, row: &StepReport) {
        if let Some(tool) = &row.tool {
            let _ = self.samples.push(Sample { time: row.time, force: tool.force, torque: tool.torque });
        }
    }
}

/// What can be changed of a simulation.
pub(super) fn settings(simulation: &Simulation, is_held: bool) -> Settings {
    let scene = simulation.scene();
    let of_body = |(index, body): (usize, &palpate::scene::Body)| {
        let name = body.name.clone();
        let materials = simulation.materials(index).to_vec();
        materials.into_iter().enumerate().map(move |(k, material)| {
            let name = if k == 0 { name.clone() } else { format!("{name}, region {k}") };
            (index, k, name, material)
        })
    };
    Settings {
        materials: scene.bodies.iter().enumerate().flat_map(of_body).collect(),
        contact: Some(scene.contact.clone()),
        stiffness: simulation.contact_stiffness(),
        coupling: if simulation.tool().is_some() { scene.coupling } else { None },
        is_held,
    }
}
