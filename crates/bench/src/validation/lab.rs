//! What the cases of `palpate validate` share: a device, a folder for meshes, and simulations that are stepped until
//! their body rests.

use std::cell::OnceCell;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use palpate::internal::prepare::{Layer, Shape};
use palpate::{Context, Error, Flags, Options, Result, Scene, SceneBuilder, Simulation, StepReport};
use palpate_oracle::elastic::Elements;

use super::Settings;
use super::cases::Case;
use super::series::{Level, Quantity};
use crate::meshes::MeshFolder;

/// Number of steps from one look at the displacements to the next, while a body comes to rest.
const STRIDE: usize = 10;
/// A body rests if what its displacements still have to go is at most this share of the largest.
const AT_REST: f64 = 1e-5;
/// A body also rests if its displacements change by at most this share of the largest in [`STRIDE`] steps: the rounding
/// of single precision, and what the solver leaves.
const ROUNDING: f64 = 1e-6;

/// The device on which the cases run, and the folder of their meshes.
pub struct Lab<'a> {
    context: Arc<Context>,
    /// Meshes of bodies that a scene cannot describe by numbers.
    pub folder: MeshFolder,
    is_quick: bool,
    case: &'static str,
    watch: &'a mut dyn FnMut(&str),
}

impl<'a> Lab<'a> {
    /// Opens the device. `watch` is told of each simulation. Errors: those of [`Context::open`], and a temporary folder
    /// that cannot be made.
    pub fn new(settings: &Settings, watch: &'a mut dyn FnMut(&str)) -> Result<Lab<'a>> {
        let options =
            Options { device: settings.device.clone(), replaced: settings.replaced.clone(), ..Options::of_program() };
        Ok(Lab {
            context: Context::open(&options)?,
            folder: MeshFolder::new()?,
            is_quick: settings.is_quick,
            case: "",
            watch,
        })
    }

    /// The device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Runs a case. Errors: those of its simulations.
    pub fn measure(&mut self, case: &Case) -> Result<Vec<Quantity>> {
        self.case = case.name;
        (case.measure)(self)
    }

    /// The levels of a study of refinement that are run: all of them, or in the quick form the first three.
    pub fn levels<'b, T>(&self, all: &'b [T]) -> &'b [T] {
        if self.is_quick { &all[..all.len().min(3)] } else { all }
    }

    /// Opens the scene of the text of a scene file. `label` names the level, for those who wait.
    pub fn open(&mut self, label: &str, text: &str) -> Result<Run> {
        self.open_scene(label, &SceneBuilder::new(self.case).toml(text)?.build()?)
    }

    /// Opens a scene.
    pub fn open_scene(&mut self, label: &str, scene: &Scene) -> Result<Run> {
        (self.watch)(&format!("{}: {label}", self.case));
        let simulation = Simulation::on_device(&self.context, scene)?;
        Ok(Run { simulation, label: label.into(), flags: Flags::default(), steps: 0, masses: OnceCell::new() })
    }
}

/// A simulation whose first body is observed.
pub struct Run {
    /// The simulation.
    pub simulation: Simulation,
    label: String,
    flags: Flags,
    steps: usize,
    /// Masses of the first body's nodes, kg, computed where they are asked for.
    masses: OnceCell<Vec<f64>>,
}

impl Run {
    /// Does a step, and keeps its flags.
    pub fn step(&mut self) -> Result<StepReport> {
        let report = self.simulation.step()?;
        self.flags = Flags(self.flags.0 | report.flags.0);
        self.steps += 1;
        Ok(report)
    }

    /// The layer (tetrahedral mesh) of the first body, undeformed.
    pub fn layer(&self) -> &Layer {
        match &self.simulation.bodies()[0].shape {
            Shape::Soft { layer, .. } => layer,
            _ => panic!("the first body of a case is soft"),
        }
    }

    /// Number of steps so far.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Momentum of the first body, kg m/s.
    pub fn momentum(&self) -> Result<DVec3> {
        let material = self.simulation.materials(0)[0];
        let masses = self.masses.get_or_init(|| Elements::new(self.layer(), material, DMat3::IDENTITY).masses);
        Ok(masses.iter().zip(self.nodes()?.1).map(|(mass, v)| *mass * v).sum())
    }

    /// Displacements of the first body's nodes, m.
    pub fn displacements(&self) -> Result<Vec<DVec3>> {
        Ok(self.nodes()?.0)
    }

    /// Displacements (m) and velocities (m/s) of the first body's nodes.
    fn nodes(&self) -> Result<(Vec<DVec3>, Vec<DVec3>)> {
        let rigid = || Error::Simulation(format!("{}: the first body is not soft", self.label));
        self.simulation.nodes(0)?.ok_or_else(rigid)
    }

    /// Index of the node of the first body that is nearest to a place at rest.
    pub fn node(&self, place: DVec3) -> usize {
        let far = |node: &DVec3| node.distance_squared(place);
        let nodes = self.layer().nodes.iter().enumerate();
        nodes.min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b))).map_or(0, |(index, _)| index)
    }

    /// Displacement of the node that is nearest to a place at rest, m.
    pub fn displacement(&self, place: DVec3) -> Result<DVec3> {
        Ok(self.displacements()?[self.node(place)])
    }

    /// Steps until the first body rests: until its displacements, whose changes from look to look shrink by a factor,
    /// would change by no more than [`AT_REST`] in all steps to come, at two looks in a row. The first `least` steps
    /// are done in any case. Errors: after `most` steps it still moves, or a displacement is not finite.
    pub fn rest(&mut self, least: usize, most: usize) -> Result<()> {
        let mut before = self.displacements()?;
        let (mut last_change, mut was_at_rest) = (f64::INFINITY, false);
        while self.steps < most {
            for _ in 0..STRIDE {
                self.step()?;
            }
            let now = self.displacements()?;
            let largest = now.iter().map(|d| d.length()).fold(0.0, f64::max);
            let change = before.iter().zip(&now).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            let shrinks = change / last_change;
            let to_come = if shrinks < 1.0 { change * shrinks / (1.0 - shrinks) } else { f64::INFINITY };
            if now.iter().any(|d| !d.is_finite()) {
                return Err(Error::Simulation(format!("{}: a displacement is not finite", self.label)));
            }
            let is_at_rest = change <= ROUNDING * largest || to_come <= AT_REST * largest;
            if self.steps >= least && is_at_rest && was_at_rest {
                return Ok(());
            }
            (before, last_change, was_at_rest) = (now, change, is_at_rest);
        }
        Err(Error::Simulation(format!("{}: the body still moves after {most} steps", self.label)))
    }

    /// The level of a study of refinement that this run gives.
    pub fn level(&self, size: f64, value: f64) -> Level {
        let flags = self.flags.names().map(String::from).collect();
        Level { label: self.label.clone(), size, value, flags }
    }
}
