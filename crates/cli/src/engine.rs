//! Connects the program to the engine: does the steps of a run, collects their times, and reads back the results at the
//! end. A step consists of *stages*; the *step plan* says which stages are recorded for the GPU and which are left out
//! because the scene does not need them. The *tool* is the rigid body that the haptic device leads.

use glam::DVec3;
use palpate::internal::gpu::DeviceInfo;
use palpate::internal::prepare::Shape;
use palpate::internal::prepare::distance::Solid;
use palpate::internal::stages::query_as_one;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::{self, ToolShape};
use palpate::{Context, Error, Options, Result, Scene, Simulation, StepReport};

use crate::report::felt::Distance;
use crate::report::{Facts, Plan, StageSamples};

/// A running simulation, and the times of its stages.
pub struct Engine {
    simulation: Simulation,
    stages: Vec<StageSamples>,
    iterations: u64,
    steps: u64,
}

/// Results of a run.
pub struct Outcome {
    /// Vulkan device, step plan and times.
    pub facts: Facts,
    /// Layers (tetrahedral meshes) of the soft bodies.
    pub layers: Vec<LayerResult>,
    /// Skins (surface meshes) of the soft bodies.
    pub skins: Vec<SkinResult>,
}

/// A layer (tetrahedral mesh) at the end of a run, for `NAME.vtk`.
pub struct LayerResult {
    /// Name of the body.
    pub name: String,
    /// World positions of the deformed layer's nodes, m, in the order in which the mesh was read or generated.
    pub nodes: Vec<DVec3>,
    /// Indices of the four nodes of each tetrahedron.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Displacement of each node along world axes, m, from the node's position in the undeformed body at the pose that
    /// the scene gives the body.
    pub displacement: Vec<DVec3>,
}

/// A skin (surface mesh) at the end of a run, for `NAME.obj`.
pub struct SkinResult {
    /// Name of the body.
    pub name: String,
    /// World positions of the deformed skin's vertices, m, in the order of the surface's file.
    pub vertices: Vec<DVec3>,
    /// Indices of the three vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Engine {
    /// Prepares the scene, opens the Vulkan device and records the GPU commands of a step.
    pub fn open(scene: &Scene, options: &Options) -> Result<Self> {
        let simulation = Simulation::open(scene, options)?;
        Ok(Engine { simulation, stages: Vec::new(), iterations: 0, steps: 0 })
    }

    /// Times each pass (dispatch, draw, fill or copy) by itself from now on, instead of each stage.
    pub fn time_passes(&mut self) -> Result<()> {
        self.simulation.time_passes()
    }

    /// Does a step of the length that the scene gives; bodies that the scene moves follow its keys (timed poses).
    pub fn step(&mut self) -> Result<StepReport> {
        let row = self.simulation.step()?;
        Ok(self.counted(row))
    }

    /// Does a step of length `h`, s, that starts from the poses and twists of devices and tools that the haptic loops
    /// give; returns the step's report and the contact wrench on each of these tools.
    pub fn step_device_inputs(&mut self, inputs: &[DeviceInput], h: f64) -> Result<(StepReport, Vec<ContactWrench>)> {
        let row = self.simulation.step_device_inputs(inputs, h)?;
        let wrenches = self.simulation.contact_wrenches(inputs);
        Ok((self.counted(row), wrenches))
    }

    /// The simulation, to read its state.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// The simulation, to be drawn or read between two steps.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    fn counted(&mut self, row: StepReport) -> StepReport {
        self.steps += 1;
        self.iterations += u64::from(row.iterations);
        for (stage, us) in self.simulation.stage_times().unwrap_or_default() {
            match self.stages.iter_mut().find(|samples| samples.stage == *stage) {
                Some(samples) => samples.us.push(*us),
                None => self.stages.push(StageSamples { stage: stage.clone(), passes: 0, us: vec![*us] }),
            }
        }
        row
    }

    /// Reads back the results of the steps done. The times of the stages are moved into the outcome, so this is called
    /// once, at the end of a run.
    pub fn results(&mut self) -> Result<Outcome> {
        let mean_iterations = self.iterations.div_ceil(self.steps.max(1)) as u32;
        let (passes, _) = self.simulation.passes(mean_iterations);
        let per_step = |(what, count): &(String, u64)| (what.clone(), count.div_ceil(self.steps.max(1)) as u32);
        let all_passes = self.simulation.pass_counts().iter().map(per_step).chain(passes.iter().cloned());
        let all_passes: Vec<(String, u32)> = all_passes.collect();
        for samples in &mut self.stages {
            let of_timer =
                |(timed, _): &&(String, u32)| samples.stage == *timed || samples.stage == query_as_one(timed);
            samples.passes = all_passes.iter().filter(of_timer).map(|(_, n)| n).sum();
        }
        let (mut layers, mut skins) = (Vec::new(), Vec::new());
        for (index, body) in self.simulation.bodies().iter().enumerate() {
            let Shape::Soft { layer, skin, .. } = &body.shape else { continue };
            let Some((moved, _)) = self.simulation.nodes(index)? else { continue };
            let nodes = self.simulation.node_positions(index)?;
            let vertices = self.simulation.skin_positions(index)?;
            skins.push(SkinResult { name: body.name.clone(), vertices, triangles: skin.triangles.clone() });
            layers.push(LayerResult {
                name: body.name.clone(),
                nodes,
                tetrahedra: layer.tetrahedra.clone(),
                displacement: moved.iter().map(|d| body.orientation * *d).collect(),
            });
        }
        let context = self.simulation.context();
        let plan = self.simulation.plan().entries.iter();
        let facts = Facts {
            device: context.device_name().into(),
            driver: context.driver().into(),
            arrays: self.simulation.kind_of_arrays().into(),
            plan: plan
                .map(|e| Plan { stage: e.stage.into(), recorded: e.recorded, reason: e.reason.clone() })
                .collect(),
            passes_per_step: passes.iter().map(|(_, n)| n).sum(),
            bytes_device: context.bytes_allocated(),
            stages: std::mem::take(&mut self.stages),
            files: self.simulation.reports().map(|(name, report)| (name.into(), report.clone())).collect(),
        };
        Ok(Outcome { facts, layers, skins })
    }
}

/// The soft body or plane that is nearest to the tool among those that may touch it, and the distance from the tool's
/// surface if the tool is a sphere, else from its centre. `None` without a tool or such a body.
pub fn nearest(simulation: &Simulation, skins: &[SkinResult]) -> Option<Distance> {
    let tool = simulation.tool()?;
    let shape = &simulation.scene().tool.as_ref()?.shape;
    let radius = shape.radius();
    let name = if let ToolShape::Body(name) = shape { name.as_str() } else { "tool" };
    let may_touch = |body: &&scene::Body| {
        body.name != name && body.collides.as_ref().is_none_or(|names| names.iter().any(|other| other == name))
    };
    let distance = |body: &scene::Body| match &body.shape {
        scene::Shape::Plane { normal, offset } => Some(normal.dot(tool.centre) - offset),
        _ => {
            let skin = skins.iter().find(|skin| skin.name == body.name)?;
            Solid::new(&skin.vertices, &skin.triangles).ok().map(|solid| solid.distance(tool.centre))
        }
    };
    let all = simulation
        .scene()
        .bodies
        .iter()
        .filter(may_touch)
        .filter_map(|body| Some((body.name.clone(), distance(body)?)));
    let (body, distance) = all.filter(|(_, distance)| distance.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Distance { body, distance: distance - radius.unwrap_or(0.0), is_of_surface: radius.is_some() })
}

/// The Vulkan devices of this machine, usable or not.
pub fn devices() -> Result<Vec<DeviceInfo>> {
    let devices = Context::list()?;
    if devices.is_empty() {
        return Err(Error::NoDevice("there is no Vulkan device; install a Vulkan driver".into()));
    }
    Ok(devices)
}
