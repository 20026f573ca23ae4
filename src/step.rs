//! The step: pose in, wrench out. Which stages run in which order stands in `algorithm.rs`; this file has what a user of a
//! [`Simulation`] sees.

mod algorithm;
mod change;
mod contact_wrench;
mod contacts;
pub mod drive;
mod explain;
pub mod frames;
mod gap;
mod held;
pub mod joints;
mod make;
mod nodes;
mod probes;
mod report;
mod rigid;
mod saved;
mod shown;
mod stage_set;
pub mod tool;
mod tools;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use crate::Result;
use crate::gpu::Context;
use crate::plan::Plan;
use crate::prepare::{Body, BodyReport, Shape};
use crate::scene::{Coupling, Key, Scene};
use crate::shaders::{self, Counts, Frame, Link, Pair, Region, Report, StepParams};
pub use crate::stages::Flags;
use crate::stages::depth::Path;
use crate::stages::joints::Joint;
use crate::stages::model::{self, Model};
use algorithm::Recordings;
pub use contact_wrench::{ContactWrench, Gap};
pub use contacts::ContactPoint;
use drive::Drive;
use frames::Frames;
pub use held::Held;
use probes::ProbePlace;
pub use report::{Pose, StepReport, ToolReport};
pub use rigid::{RigidState, Wrench};
pub use shown::{Cut, Field, FieldValues, Mesh, Overlay, Part, RegionSquare, Skins};
use stage_set::Stages;
use tool::Tool;

/// How often a step that fails is halved: eighths of it at last.
const MOST_HALVINGS: u32 = 3;
/// Every so many steps are timed, unless [`Simulation::time_every`] says otherwise: timestamps split the work and cost up to
/// a millisecond on some drivers.
pub const TIMED_EVERY: u64 = 8;

/// A scene under way.
pub struct Simulation {
    context: Arc<Context>,
    scene: Scene,
    bodies: Vec<Body>,
    /// The tool's, where it is none of the scene's bodies.
    tool_body: Option<Body>,
    model: Model,
    stages: Stages,
    plain: Recordings,
    /// Timed by stage; with the query's stages as one.
    timed: Option<[Recordings; 2]>,
    tool: Option<Tool>,
    frames: Frames,
    drive: Drive,
    probes: Vec<ProbePlace>,
    plan: Plan,
    /// The kind of arrays that kernels read, and why.
    kind_of_arrays: String,
    path: Option<Path>,
    step: u64,
    /// At the end of the last step, s.
    time: f64,
    /// Whether the tool, or the body that is held, has weight; the loop carries it.
    has_weight: bool,
    /// Of the body that is held, kg.
    held_mass: f64,
    /// Greatest force of the coupling's stiffness, N.
    max_force: f64,
    last_wrench: Option<ContactWrench>,
    last_iterations: u32,
    last_timed: Option<Vec<(String, f64)>>,
    timed_every: u64,
    /// Whether friction is recorded.
    has_friction: bool,
    /// Whether the device still has what the solver applied in the last step.
    is_solved: bool,
    /// What positions of the last step are relative to on the device, m.
    step_origin: DVec3,
    /// Where the layers of bodies are cut open for who looks, if not where they are at first.
    cuts: BTreeMap<usize, Cut>,
    /// Where somebody looks.
    shown: Option<shown::Shown>,
}

impl Simulation {
    /// One step of the scene's `dt`, with the device where the scene's keys put it: pose in, wrench out. After
    /// [`Simulation::step_held`], which leaves the keys for good, the device stays where that had it.
    pub fn step(&mut self) -> Result<StepReport> {
        let h = self.scene.step.dt;
        self.has_weight = true;
        self.step_to(self.next_end(h), h)
    }

    /// A step of `h` s for the loop: from its tool (but where contact pushed in the last step no further out than that left it),
    /// towards its device as it is now. Where the device will be at the end nobody
    /// knows: taken to go on as it moves, at 50 steps a second it makes contact swing that is steady without (README, "The
    /// hand"). A tool that is a soft body's core stays the simulation's. Weight is not felt: what the hand holds is carried.
    #[doc(hidden)]
    pub fn step_held(&mut self, held: &Held, h: f64) -> Result<StepReport> {
        let time = self.time + h;
        self.has_weight = false;
        let RigidState { position, orientation, .. } = held.device;
        self.drive = Drive::new(&[], Key { time: self.time, position, orientation });
        self.max_force = held.max_force;
        if let Some(tool) = &mut self.tool {
            tool.coupling = held.coupling;
        }
        if let (Some(tool), None) = (&mut self.tool, self.model.held) {
            let RigidState { position, orientation, velocity, angular_velocity } = held.tool;
            // The body is as the last step left it. From further out the step would begin without contact, which is found at its
            // beginning, and the tool fall into the body unopposed.
            let normal = self.last_wrench.and_then(|wrench| wrench.normal()).unwrap_or_default();
            let out = normal.dot(position - tool.centre).max(0.0);
            (tool.centre, tool.orientation) = (position - out * normal, orientation);
            (tool.velocity, tool.angular_velocity) = (velocity, angular_velocity);
        }
        let row = self.step_to(time, h);
        self.max_force = f64::INFINITY;
        let row = row?;
        if let Some(wrench) = &mut self.last_wrench {
            wrench.time = held.time;
            wrench.is_driven = self.frames.is_any_driven(time - h, time);
        }
        Ok(row)
    }

    /// What the tool felt in the last step, with stiffness and damping if that was [`Simulation::step_held`] (else zero: nobody
    /// asks); `None`: there is no tool, or was no step.
    #[doc(hidden)]
    pub fn contact_wrench(&self) -> Option<&ContactWrench> {
        self.last_wrench.as_ref()
    }

    /// A step of the scene's `dt` with the device at this pose at its end, having moved evenly from where it was.
    pub fn step_at(&mut self, pose: Pose) -> Result<StepReport> {
        let h = self.scene.step.dt;
        let end = self.next_end(h);
        self.has_weight = true;
        self.drive.lead(end - h, Key { time: end, position: pose.position, orientation: pose.orientation });
        self.step_to(end, h)
    }

    fn step_to(&mut self, time: f64, h: f64) -> Result<StepReport> {
        let begun = Instant::now();
        self.step += 1;
        let report = self.advance(time - h, h, MOST_HALVINGS)?;
        self.time = time;
        // A frozen step leaves the forces of a solve that was not accepted.
        self.is_solved = !Flags(report.flags).contains(Flags::FROZEN);
        let device = self.drive.device(time, h);
        let probes = self.read_probes()?;
        self.last_wrench = self.tool.as_ref().map(|tool| tools::contact_wrench(tool, self.step, &report));
        self.add_gap(&report)?;
        Ok(self.row(&report, time, &device, probes, begun))
    }

    /// The scene that it was made of, with what was changed since.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// At the end of the last step, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Contact stiffness of the stiffest pair of bodies, N/m^3; 0: nothing can touch.
    #[doc(hidden)]
    pub fn contact_stiffness(&self) -> f64 {
        self.model.pairs.iter().map(|pair| f64::from(pair.stiffness)).fold(0.0, f64::max)
    }

    /// What joins tool and device from now on. The loop chooses its own; whoever steps on without it gives back what there was.
    #[doc(hidden)]
    pub fn couple(&mut self, coupling: Option<Coupling>) {
        if let Some(tool) = &mut self.tool {
            tool.coupling = coupling;
        }
    }

    /// When the next step of `h` s ends, s: a whole multiple of it, unless the loop took steps of its own length.
    pub(super) fn next_end(&self, h: f64) -> f64 {
        if self.time == self.step as f64 * h { (self.step + 1) as f64 * h } else { self.time + h }
    }

    /// The device that runs the step.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// Iterations of the last step's longest solve.
    pub fn last_iterations(&self) -> u32 {
        self.last_iterations
    }

    /// The stages that were recorded, and those left out with the reason.
    #[doc(hidden)]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The kind of buffers through which kernels read their arrays, and why it was chosen.
    #[doc(hidden)]
    pub fn kind_of_arrays(&self) -> &str {
        &self.kind_of_arrays
    }

    /// The path of the depth stage, where the step has one.
    #[doc(hidden)]
    pub fn depth_path(&self) -> Option<Path> {
        self.path
    }

    /// Times every so many steps from now on, in turn stage by stage, and the query's stages as one; 0: none, and the
    /// recordings with timestamps go.
    pub fn time_every(&mut self, steps: u64) -> Result<()> {
        match steps {
            0 => self.timed = None,
            _ if self.timed.is_none() => self.timed = Some(make::timed(&self.context, &self.stages, &self.scene)?),
            _ => {}
        }
        self.timed_every = steps;
        Ok(())
    }

    /// Times of the stages in the last step, microseconds, where it was a timed one; in every second such step those of the
    /// query are one, [`POSE_TO_CONTACT`](crate::stages::POSE_TO_CONTACT).
    pub fn stage_times(&self) -> Option<&[(String, f64)]> {
        self.last_timed.as_deref()
    }

    /// Dispatches, draws, fills and copies of each stage in a step of `iterations` solver iterations, and how many passes
    /// of the whole wait for an earlier one.
    #[doc(hidden)]
    pub fn passes(&self, iterations: u32) -> (Vec<(String, u32)>, u32) {
        let mut stages: Vec<(String, u32)> = Vec::new();
        let mut dependent = 0;
        for (recording, share) in self.parts(iterations) {
            for part in recording.passes() {
                let passes = (f64::from(part.dispatches) * share).round() as u32;
                dependent += (f64::from(part.dependent) * share).round() as u32;
                match stages.iter_mut().find(|(name, _)| *name == part.stage) {
                    Some((_, sum)) => *sum += passes,
                    None => stages.push((part.stage.clone(), passes)),
                }
            }
        }
        (stages, dependent)
    }

    /// The bodies as prepared.
    #[doc(hidden)]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// What was found in the files of each body, and of the tool, and done about it.
    #[doc(hidden)]
    pub fn reports(&self) -> impl Iterator<Item = (&str, &BodyReport)> {
        let bodies = self.bodies.iter().map(|body| (body.name.as_str(), &body.report));
        bodies.chain(self.tool_body.iter().map(|body| ("tool", &body.report)))
    }

    /// The tool, if the scene has one; of a body that is held, its core.
    #[doc(hidden)]
    pub fn tool(&self) -> Option<&Tool> {
        self.tool.as_ref()
    }

    /// Where the frames of a body are now: one a core, or one that floats or carries a rigid skin; empty for a half-space.
    #[doc(hidden)]
    pub fn frames(&self, body: usize) -> Vec<frames::Place> {
        let first = self.model.body_frames[body];
        let count = match &self.bodies[body].shape {
            Shape::Soft { frames, .. } => frames.len(),
            Shape::Rigid { .. } => 1,
            Shape::Plane { .. } => 0,
        };
        (0..count).map(|k| self.frames.place(first as usize + k)).collect()
    }

    /// Joints between frames of all bodies, one body's after another's.
    #[doc(hidden)]
    pub fn joints(&self) -> &[Joint] {
        &self.model.joints
    }

    /// The region of each pair of bodies and the contacts of the last step, as the device left them (a dropped contact has
    /// stiffness 0); empty where nothing can touch. Positions are relative to the origin of that step. Costs transfers of
    /// its own: for tests and export.
    #[doc(hidden)]
    pub fn touch(&self) -> Result<(Vec<Region>, Vec<shaders::Contact>)> {
        let Some(touch) = &self.stages.touch else { return Ok((Vec::new(), Vec::new())) };
        let count = self.stages.common.counts.read::<Counts>()?[0].contacts as usize;
        let mut contacts = touch.contact.touch.contacts.read::<shaders::Contact>()?;
        contacts.truncate(count);
        Ok((touch.cull.regions.read::<Region>()?, contacts))
    }

    /// Where f32 positions are measured from: the tool, or the first body; contact needs digits there.
    fn origin(&self) -> DVec3 {
        let first = self.model.frames.first().map_or(DVec3::ZERO, |_| self.frames.place(0).centre);
        self.tool.as_ref().map_or(first, |tool| tool.centre)
    }

    fn write_inputs(&self, h: f64, device: &RigidState) -> Result<()> {
        let (step, origin) = (&self.scene.step, self.origin());
        let mut params = StepParams {
            dt: h as f32,
            tolerance: self.scene.solver.tolerance as f32,
            max_iterations: self.scene.solver.max_iterations,
            newton: step.newton,
            gravity: step.gravity.as_vec3().to_array(),
            depth_limit: self.scene.contact.depth_limit as f32,
            texel: self.scene.contact.texel.unwrap_or(0.0) as f32,
            is_held: u32::from(!self.has_weight),
            friction: self.model.friction[0],
            friction_speed: self.model.friction[1],
            ..bytemuck::Zeroable::zeroed()
        };
        if let Some(tool) = &self.tool {
            let device = &tool.within_reach(device, self.max_force);
            let gravity = if self.has_weight { step.gravity } else { DVec3::ZERO };
            let mut rows = match self.model.held {
                Some(_) => tool.coupling_rows(h, device),
                None => tool.rows(h, gravity, device),
            };
            if self.model.held.is_some() && !self.has_weight {
                (0..3).for_each(|k| rows.rhs[k] -= h * self.held_mass * step.gravity[k]);
            }
            params.tool_matrix = std::array::from_fn(|k| rows.matrix[k / 6][k % 6] as f32);
            params.tool_rhs = rows.rhs.map(|x| x as f32);
            let (v, w) = (tool.velocity, tool.angular_velocity);
            params.tool_twist = [v.x, v.y, v.z, w.x, w.y, w.z].map(|x| x as f32);
            params.tool_centre = (tool.centre - origin).as_vec3().to_array();
        }
        self.stages.common.params.mapped_mut::<StepParams>()?[0] = params;

        let mut frames = self.stages.common.frames.mapped_mut::<Frame>()?;
        let mut links = self.stages.common.links.mapped_mut::<Link>()?;
        self.frames.write(origin, h, &mut frames, &mut links);
        joints::write(&self.model.joints, &self.frames, h, &mut self.stages.common.joints.mapped_mut()?);
        if let Some(touch) = &self.stages.touch {
            let mut pairs = touch.cull.pairs.mapped_mut::<Pair>()?;
            for (i, (pair, plane)) in self.model.pairs.iter().zip(&self.model.pair_planes).enumerate() {
                pairs[i] = *pair;
                if let Some(plane) = plane {
                    let offset = plane.offset - plane.normal.dot(origin);
                    pairs[i].plane = model::texel(plane.normal, offset);
                }
            }
        }
        Ok(())
    }

    fn read_probes(&self) -> Result<Vec<DVec3>> {
        let Some(probes) = &self.stages.probes else { return Ok(Vec::new()) };
        let moved = probes.displacement.mapped::<[f32; 4]>()?;
        let place = |(probe, d): (&ProbePlace, &[[f32; 4]])| {
            let point = |((rest, weight, frame), d): (&(DVec3, f64, usize), &[f32; 4])| {
                let local = *rest + DVec3::new(d[0].into(), d[1].into(), d[2].into());
                *weight * self.frames.world(*frame, local)
            };
            probe.points.iter().zip(d).map(point).sum()
        };
        Ok(self.probes.iter().zip(moved.chunks(4)).map(place).collect())
    }

    fn row(&self, report: &Report, time: f64, device: &RigidState, probes: Vec<DVec3>, begun: Instant) -> StepReport {
        let vector = |x: [f32; 3]| DVec3::new(x[0].into(), x[1].into(), x[2].into());
        let touch = self.stages.touch.is_some();
        StepReport {
            step: self.step,
            time,
            tool: self.tool.as_ref().map(|tool| ToolReport {
                tool: Pose { position: tool.centre, orientation: tool.orientation },
                device: Pose { position: device.position, orientation: device.orientation },
                force: vector(report.force),
                torque: vector(report.torque),
            }),
            contacts: touch.then_some(report.contacts),
            max_depth: touch.then_some(f64::from(report.max_depth)),
            normal_turn: touch.then_some(f64::from(report.turn)),
            iterations: report.iterations,
            residual: f64::from(report.residual),
            flags: Flags(report.flags),
            step_us: begun.elapsed().as_secs_f64() * 1e6,
            probes,
        }
    }
}
