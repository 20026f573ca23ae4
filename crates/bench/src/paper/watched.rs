//! A simulation whose steps with contact are timed alternately: one by the wall time of the whole step, the next by GPU
//! timestamps of its stages.

use std::collections::BTreeMap;

use palpate::internal::prepare::Shape;
use palpate::internal::stages::POSE_TO_CONTACT;
use palpate::{Options, Result, Scene, Simulation, StepReport, Threads};
use serde::{Deserialize, Serialize};

use super::Settings;
use crate::median;

/// Every second step has timestamps. Of four steps two have none, one times each stage, and one times the query (the
/// stages that find contacts) as a whole.
const TIMED_EVERY: u64 = 2;

/// Times and contacts of the steps with contact. Each list holds one quantity, with an entry for each step in which
/// this quantity was measured.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Times {
    /// Number of steps with contact.
    pub touching: usize,
    /// Time of each stage by its name, us.
    pub stages_us: BTreeMap<String, Vec<f64>>,
    /// Time of the query (the stages from `pose` to `contact`) as a whole, us.
    pub query_us: Vec<f64>,
    /// Wall time of the steps without timestamps, from the input of poses to the output of the contact wrench, us.
    pub step_us: Vec<f64>,
    /// Number of contacts of a step, found at the vertices of both touching bodies' skins (surface meshes).
    pub contacts: Vec<u32>,
    /// Total area of the contacts of a step, projected along the contact normals, m^2.
    pub areas: Vec<f64>,
    /// Number of solver iterations of a step, summed over its linear solves.
    pub iterations: Vec<u32>,
}

impl Times {
    /// Median time of the query, ms.
    pub fn query_ms(&self) -> f64 {
        1e-3 * median(&self.query_us)
    }

    /// Median wall time of a step, ms.
    pub fn step_ms(&self) -> f64 {
        1e-3 * median(&self.step_us)
    }

    /// Median time of a stage, ms; `None`: no such stage was timed.
    pub fn stage_ms(&self, stage: &str) -> Option<f64> {
        self.stages_us.get(stage).map(|us| 1e-3 * median(us))
    }

    /// Median number of contacts of a step.
    pub fn contacts(&self) -> f64 {
        of(&self.contacts)
    }

    /// Median of the total contact area of a step, m^2.
    pub fn area(&self) -> f64 {
        median(&self.areas)
    }

    /// Median number of solver iterations of a step.
    pub fn iterations(&self) -> f64 {
        of(&self.iterations)
    }
}

fn of(counts: &[u32]) -> f64 {
    median(&counts.iter().map(|&n| n.into()).collect::<Vec<f64>>())
}

/// A running simulation whose steps can be timed.
pub struct Watched(Simulation);

impl Watched {
    /// Opens a scene; no step has timestamps yet. Errors: those of [`Simulation::new`].
    pub fn open(scene: &Scene, settings: &Settings) -> Result<Watched> {
        let options =
            Options { device: settings.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
        let mut simulation = Simulation::open(scene, &options)?;
        simulation.time_every(0)?;
        Ok(Watched(simulation))
    }

    /// Number of tetrahedra and number of skin vertices of all bodies together. The tool (rigid body that the haptic
    /// device leads) is not counted.
    pub fn sizes(&self) -> (usize, usize) {
        let sizes = self.0.bodies().iter().map(|body| match &body.shape {
            Shape::Soft { layer, skin, .. } => (layer.tetrahedra.len(), skin.vertices.len()),
            Shape::Rigid { skin, .. } => (0, skin.vertices.len()),
            Shape::Plane { .. } => (0, 0),
        });
        sizes.fold((0, 0), |sum, size| (sum.0 + size.0, sum.1 + size.1))
    }

    /// GPU memory that the simulation's buffers and images occupy, bytes.
    pub fn bytes(&self) -> u64 {
        self.0.context().bytes_allocated()
    }

    /// Does a step; if `times` is given and the step has contacts, adds the step's measurements to `times`.
    pub fn step(&mut self, times: Option<&mut Times>) -> Result<StepReport> {
        self.0.time_every(if times.is_some() { TIMED_EVERY } else { 0 })?;
        let row = self.0.step()?;
        let Some((times, contacts)) = times.zip(row.contacts.filter(|&found| found > 0)) else { return Ok(row) };
        times.areas.push(self.0.touch()?.1.iter().map(|contact| f64::from(contact.area)).sum());
        times.touching += 1;
        times.contacts.push(contacts);
        times.iterations.push(row.iterations);
        match self.0.stage_times() {
            None => times.step_us.push(row.step_us),
            Some(stages) => times.add(stages),
        }
        Ok(row)
    }
}

impl Times {
    fn add(&mut self, stages: &[(String, f64)]) {
        if let Some((_, us)) = stages.iter().find(|(name, _)| name == POSE_TO_CONTACT) {
            self.query_us.push(*us);
            return;
        }
        for (name, us) in stages {
            self.stages_us.entry(name.clone()).or_default().push(*us);
        }
    }
}
