//! The step of a simulation: its input is the pose of the haptic device, its output the contact wrench on the tool (the
//! rigid body that the device leads); a scene may have several of both. A virtual coupling, a spring and damper, connects
//! the tool to the device. The order of the stages is in `algorithm.rs`; this file has what a user of a [`Simulation`]
//! sees. Outside a haptic loop the device follows the scene's keys (poses at given times) or poses that the caller gives. A haptic loop runs in
//! another thread and moves the tool a thousand times a second, while steps follow one another as fast as they are
//! computed. A core is a rigid body inside a soft one, to which nodes are attached; a skin is the surface mesh of a
//! body.

mod algorithm;
mod change;
mod contact_wrench;
mod contacts;
mod device_input;
mod explain;
pub mod frames;
mod gap;
pub mod joints;
mod make;
mod nodes;
mod passing;
mod plans;
mod probes;
mod reactions;
mod report;
mod rigid;
mod saved;
mod shown;
mod stage_set;
pub mod tool;
mod tools;
pub mod trajectory;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use crate::gpu::Context;
use crate::plan::Plan;
use crate::prepare::{Body, BodyReport, Shape};
use crate::scene::{Coupling, Key, Scene};
use crate::shaders::{self, ContactPatch, Counts, Frame, Link, Pair, Report, StepParams};
use crate::stages::depth::Path;
use crate::stages::joints::Joint;
use crate::stages::model::{self, Model};
pub use crate::stages::{Explanation, Flags};
use crate::{Error, Result};
use algorithm::Recordings;
pub use contact_wrench::{ContactWrench, FARTHER, Gap};
pub use contacts::{ContactPoint, VertexForce};
pub use device_input::DeviceInput;
use frames::Frames;
use probes::ProbePlace;
pub use report::{Pose, StepReport, StepWork, ToolReport};
pub use rigid::{RigidState, Wrench};
pub use shown::{ContactPatchRectangle, Cut, Field, FieldValues, Mesh, Overlay, Part, Skins, TetrahedronFields};
use stage_set::Stages;
use tool::Tool;
use tools::HeldTool;
use trajectory::Trajectory;

/// How often in succession a failed step may be halved; the shortest attempts are eighths of the step.
const MOST_HALVINGS: u32 = 3;
/// Relative residuals between which the solver of a scene without a tolerance stops.
const TIGHTEST: f64 = 1e-5;
const LOOSEST: f64 = 1e-2;
/// One step in this many is timed, unless [`Simulation::time_every`] sets another number: timestamps split the GPU's
/// work and cost up to a millisecond on some drivers.
pub const TIMED_EVERY: u64 = 8;

/// What timestamps measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Timing {
    Nothing,
    /// In every second timed step each stage by itself, in the others the stages from pose to contact as one.
    Stages,
    /// Each pass by itself.
    Passes,
}

/// A scene that is being simulated.
pub struct Simulation {
    context: Arc<Context>,
    scene: Scene,
    bodies: Vec<Body>,
    /// The tool's own body, where the tool is none of the scene's bodies.
    tool_body: Option<Body>,
    model: Model,
    stages: Stages,
    plain: Recordings,
    timing: Timing,
    /// The sets of recordings (command buffers of a step) with timestamps, which timed steps use in turn: see
    /// [`Timing`].
    timed: Vec<Recordings>,
    /// The tool; of several the first.
    tool: Option<Tool>,
    further_tools: Vec<HeldTool>,
    frames: Frames,
    trajectory: Trajectory,
    /// What keeps a rigid tool from passing through bodies.
    passing: Option<passing::Passing>,
    /// Centre of a rigid tool at the end of the last step, m; `None` before the first, and after a state was restored.
    tool_end: Option<DVec3>,
    probes: Vec<ProbePlace>,
    plan: Plan,
    /// The kind of buffers through which kernels read their arrays, and why it was chosen.
    kind_of_arrays: String,
    path: Option<Path>,
    step: u64,
    /// Simulated time at the end of the last step, s.
    time: f64,
    /// Whether the tool has weight; in a haptic loop its weight is compensated.
    has_weight: bool,
    /// Mass of a tool that is a body of the scene, kg; 0 for any other tool.
    tool_core_mass: f64,
    /// Greatest force of the virtual coupling's spring, N.
    max_force: f64,
    last_wrench: Option<ContactWrench>,
    last_reactions: Vec<Wrench>,
    last_iterations: u32,
    /// What the last steps needed, from which the next step's plan follows.
    needs: plans::Needs,
    /// What the last step asked of the GPU.
    last_work: StepWork,
    /// Number of parts in which the last step was done.
    last_parts: u32,
    last_timed: Option<Vec<(String, f64)>>,
    /// By what runs: the number of passes since [`Simulation::time_passes`].
    pass_counts: Vec<(String, u64)>,
    timed_every: u64,
    /// Whether the recordings contain friction.
    has_friction: bool,
    /// Whether the GPU still holds the contact forces that the solver applied in the last step.
    is_solved: bool,
    /// World position to which the positions on the GPU in the last step are relative, m.
    step_origin: DVec3,
    /// Per body: the plane at which its tetrahedral mesh is cut open for display, where that is not the default plane.
    cuts: BTreeMap<usize, Cut>,
    /// The arrays that are displayed, made when they are first asked for.
    shown: Option<shown::Shown>,
}

impl Simulation {
    /// Simulates one step of the scene's `dt`. The haptic device follows the scene's keys. [`Simulation::step_at`],
    /// [`Simulation::step_at_poses`] and
    /// [`Simulation::step_device_input`] replace the keys for good; after such a call the device stays at the pose that
    /// the call gave it.
    pub fn step(&mut self) -> Result<StepReport> {
        let h = self.scene.step.dt;
        self.leave_loop();
        self.step_to(self.next_end(h), h)
    }

    /// Simulates a step of `h` seconds for the haptic loop: the step starts from the loop's state of the tool, and the
    /// virtual coupling pulls the tool towards the loop's haptic device at its present pose. The pose of the device at
    /// the end of the step is not known, and extrapolating its motion, at 50 steps a second, makes a contact oscillate
    /// that is otherwise steady (docs/understanding/virtual-coupling.md). Where contact pushed the tool in the last
    /// step, the tool starts no further out along the contact normal than that step left it. A tool that is a core of a
    /// soft body keeps the simulation's own state. The weight of the tool is compensated and not felt.
    #[doc(hidden)]
    pub fn step_device_input(&mut self, input: &DeviceInput, h: f64) -> Result<StepReport> {
        self.step_device_inputs(std::slice::from_ref(input), h)
    }

    /// Like [`Simulation::step_device_input`], for several haptic devices: `inputs` are those of the first tools in the
    /// scene's order. The devices of the other tools follow their trajectories.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no input, or there are more inputs than tools.
    #[doc(hidden)]
    pub fn step_device_inputs(&mut self, inputs: &[DeviceInput], h: f64) -> Result<StepReport> {
        let tools = 1 + self.further_tools.len();
        let [input, further @ ..] = inputs else {
            return Err(Error::Usage(
                "a step of the haptic loop needs the state of a device; give one for each".into(),
            ));
        };
        if inputs.len() > tools {
            let problem = format!("{} haptic devices are given, but only {tools} can lead a tool", inputs.len());
            return Err(Error::Usage(format!("{problem}; give one for each tool at most")));
        }
        for (index, tool) in self.further_tools.iter_mut().enumerate() {
            match further.get(index) {
                Some(input) => tool.follow_loop(input, self.time),
                None => tool.leave_loop(),
            }
        }
        let time = self.time + h;
        self.has_weight = false;
        let RigidState { position, orientation, .. } = input.device;
        self.trajectory = Trajectory::new(&[], Key { time: self.time, position, orientation });
        self.max_force = input.max_force;
        if let Some(tool) = &mut self.tool {
            tool.coupling = input.coupling;
        }
        if let (Some(tool), None) = (&mut self.tool, self.model.tool_core()) {
            let RigidState { position, orientation, velocity, angular_velocity } = input.tool;
            // The touched body is as the last step left it. Contact is found at the beginning of a step, so with the
            // tool further out than in the last step this step would find no contact, and the tool would move into the
            // body unopposed.
            let normal = self.last_wrench.and_then(|wrench| wrench.normal()).unwrap_or_default();
            let out = normal.dot(position - tool.centre).max(0.0);
            (tool.centre, tool.orientation) = (position - out * normal, orientation);
            (tool.velocity, tool.angular_velocity) = (velocity, angular_velocity);
        }
        let row = self.step_to(time, h);
        self.max_force = f64::INFINITY;
        let row = row?;
        let has_kinematic_motion = self.frames.has_kinematic_motion(time - h, time);
        let wrenches =
            self.last_wrench.iter_mut().chain(self.further_tools.iter_mut().filter_map(|t| t.wrench.as_mut()));
        for (wrench, input) in wrenches.zip(inputs) {
            (wrench.time, wrench.h) = (input.time, h);
            wrench.has_kinematic_motion = has_kinematic_motion;
        }
        Ok(row)
    }

    /// Has the tools weigh again what they weigh, after a step for the haptic loop.
    fn leave_loop(&mut self) {
        self.has_weight = true;
        self.further_tools.iter_mut().for_each(HeldTool::leave_loop);
    }

    /// The contact wrench on the tool in the last step; `None` without a tool or before the first step. Stiffness and
    /// damping are computed by [`Simulation::step_device_input`] only; after other steps they are zero.
    #[doc(hidden)]
    pub fn contact_wrench(&self) -> Option<&ContactWrench> {
        self.last_wrench.as_ref()
    }

    /// The contact wrenches of the last step on the tools that `inputs`, those of that step, led; without contact where
    /// there is no tool.
    #[doc(hidden)]
    pub fn contact_wrenches(&self, inputs: &[DeviceInput]) -> Vec<ContactWrench> {
        let or_nothing = |(input, wrench): (_, Option<&_>)| *wrench.unwrap_or(&ContactWrench::nothing_at(input));
        inputs.iter().zip(self.last_wrenches()).map(or_nothing).collect()
    }

    /// The contact wrench on each tool in the last step, as [`Simulation::contact_wrench`] gives that on the first.
    #[doc(hidden)]
    pub fn last_wrenches(&self) -> impl Iterator<Item = Option<&ContactWrench>> {
        std::iter::once(self.last_wrench.as_ref()).chain(self.further_tools.iter().map(|tool| tool.wrench.as_ref()))
    }

    /// Simulates a step of the scene's `dt` that ends with the haptic device in this pose; the device moves there
    /// uniformly from its last pose.
    pub fn step_at(&mut self, pose: Pose) -> Result<StepReport> {
        let h = self.scene.step.dt;
        let end = self.next_end(h);
        self.leave_loop();
        self.trajectory.lead(end - h, Key { time: end, position: pose.position, orientation: pose.orientation });
        self.step_to(end, h)
    }

    /// Simulates a step of the scene's `dt` that ends with each haptic device in one of these poses, one for each tool in
    /// the scene's order; the devices move there uniformly from their last poses.
    ///
    /// # Errors
    /// [`Error::Usage`]: the number of poses is not that of the tools.
    pub fn step_at_poses(&mut self, poses: &[Pose]) -> Result<StepReport> {
        let tools = usize::from(self.tool.is_some()) + self.further_tools.len();
        let first = match poses.first() {
            _ if tools == 0 => return Err(Error::Usage("the scene has no tool; add a [tool]".into())),
            Some(first) if poses.len() == tools => *first,
            _ => {
                let problem = format!("{} poses are given for {tools} tools", poses.len());
                return Err(Error::Usage(format!("{problem}; give one pose for each tool of the scene")));
            }
        };
        let h = self.scene.step.dt;
        let end = self.next_end(h);
        for (tool, pose) in self.further_tools.iter_mut().zip(&poses[1..]) {
            tool.trajectory.lead(end - h, Key { time: end, position: pose.position, orientation: pose.orientation });
        }
        self.step_at(first)
    }

    fn step_to(&mut self, time: f64, h: f64) -> Result<StepReport> {
        let begun = Instant::now();
        self.step += 1;
        self.last_work = StepWork { gpu_us: self.is_timed().then_some(0.0), ..StepWork::default() };
        let report = self.advance_in_parts(time - h, h)?;
        self.time = time;
        // A frozen step, in which no attempt succeeded, leaves the forces of a solve that was not accepted.
        self.is_solved = !Flags(report.flags).contains(Flags::FROZEN);
        let device = self.trajectory.device(time, h);
        let probes = self.read_probes()?;
        self.last_reactions = self.read_reactions(&report)?;
        let friction = self.scene.contact.friction;
        self.last_wrench = self.tool.as_ref().map(|tool| tools::contact_wrench(tool, 0, self.step, &report, friction));
        for (index, tool) in self.further_tools.iter_mut().enumerate() {
            tool.feel(index, self.step, &report, friction);
        }
        self.add_gap(&report)?;
        Ok(self.row(&report, (time, h), &device, probes, begun))
    }

    /// The scene that is simulated, with the changes made since it was opened.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Simulated time at the end of the last step, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Contact stiffness of the stiffest pair of bodies, N/m^3; 0 where nothing can touch.
    #[doc(hidden)]
    pub fn contact_stiffness(&self) -> f64 {
        self.model.pairs.iter().map(|pair| f64::from(pair.stiffness)).fold(0.0, f64::max)
    }

    /// Sets the virtual coupling between tool and haptic device from now on, of several tools that of the first; the others
    /// get their scene's. A haptic loop sets couplings of its own, and a caller that continues without the loop should
    /// restore the earlier ones.
    #[doc(hidden)]
    pub fn couple(&mut self, coupling: Option<Coupling>) {
        self.further_tools.iter_mut().for_each(HeldTool::leave_loop);
        if let Some(tool) = &mut self.tool {
            tool.coupling = coupling;
        }
    }

    /// End of the next step of `h` seconds, s: a whole multiple of `h`, unless the haptic loop has taken steps of other
    /// lengths.
    pub(super) fn next_end(&self, h: f64) -> f64 {
        if self.time == self.step as f64 * h { (self.step + 1) as f64 * h } else { self.time + h }
    }

    /// The GPU context that runs the step.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// Number of solver iterations of the longest solve in the last step.
    pub fn last_iterations(&self) -> u32 {
        self.last_iterations
    }

    /// Forgets how many iterations the last steps needed, so that the next plan is the shortest. For tests.
    #[doc(hidden)]
    pub fn forget_needs(&mut self) {
        self.needs = Default::default();
    }

    /// The stages that were recorded, and those that were left out, each with the reason.
    #[doc(hidden)]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The kind of buffers through which kernels read their arrays, and why it was chosen.
    #[doc(hidden)]
    pub fn kind_of_arrays(&self) -> &str {
        &self.kind_of_arrays
    }

    /// The path of the depth stage (graphics or compute), where the step has that stage.
    #[doc(hidden)]
    pub fn depth_path(&self) -> Option<Path> {
        self.path
    }

    /// Times one step in `steps` from now on, alternately each stage by itself and the stages from pose to contact as
    /// one. With `steps` 0 no step is timed, and the recordings with timestamps are dropped.
    pub fn time_every(&mut self, steps: u64) -> Result<()> {
        self.set_timing(if steps == 0 { Timing::Nothing } else { Timing::Stages }, steps)
    }

    /// Times every pass of every step from now on, each by itself; no two passes overlap then.
    #[doc(hidden)]
    pub fn time_passes(&mut self) -> Result<()> {
        self.pass_counts.clear();
        self.set_timing(Timing::Passes, 1)
    }

    /// For each kernel, and for the fills and copies of each array: the number of its passes since
    /// [`Simulation::time_passes`] was called.
    #[doc(hidden)]
    pub fn pass_counts(&self) -> &[(String, u64)] {
        &self.pass_counts
    }

    fn set_timing(&mut self, timing: Timing, steps: u64) -> Result<()> {
        if self.timing != timing {
            self.timed = make::timed(&self.context, &self.stages, &self.scene, timing)?;
        }
        (self.timing, self.timed_every) = (timing, steps);
        Ok(())
    }

    /// Times of the stages in the last step, microseconds; `None` where that step was not timed. In every second timed
    /// step the stages from pose to contact have a single time, [`POSE_TO_CONTACT`](crate::stages::POSE_TO_CONTACT).
    /// After [`Simulation::time_passes`] the times are those of passes, by the kernel that runs, or of all fills or
    /// copies that write the same array.
    pub fn stage_times(&self) -> Option<&[(String, f64)]> {
        self.last_timed.as_deref()
    }

    /// Number of dispatches, draws, fills and copies of each stage in a step of `iterations` solver iterations, and the
    /// number of passes of all stages that must wait for an earlier pass.
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

    /// The prepared bodies.
    #[doc(hidden)]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// For each body, and the tool's own body: its name, and the report of the defects found in its files and of what
    /// was done about them.
    #[doc(hidden)]
    pub fn reports(&self) -> impl Iterator<Item = (&str, &BodyReport)> {
        let bodies = self.bodies.iter().map(|body| (body.name.as_str(), &body.report));
        bodies.chain(self.tool_body.iter().map(|body| ("tool", &body.report)))
    }

    /// What a user should know of the scene and of its files, one sentence each: values that are most likely a mistake,
    /// and what preparation changed.
    #[doc(hidden)]
    pub fn notes(&self) -> Vec<String> {
        let of_files = self.reports().flat_map(|(_, report)| report.notes.iter().cloned());
        self.scene.notes().into_iter().chain(of_files).collect()
    }

    /// The tool, if the scene has one; where the tool is a body of the scene, it moves with that body's core.
    #[doc(hidden)]
    pub fn tool(&self) -> Option<&Tool> {
        self.tool.as_ref()
    }

    /// The tools in the scene's order; those that are bodies of the scene move with their bodies' cores.
    #[doc(hidden)]
    pub fn tools(&self) -> impl Iterator<Item = &Tool> {
        self.tool.iter().chain(self.further_tools.iter().map(|tool| &tool.tool))
    }

    /// The current poses of a body's rigid coordinate frames: one per core, and one that rests where it has
    /// supports; or a single frame, which floats with a soft body without cores and supports, or carries the skin of a
    /// rigid body; none for a half-space.
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

    /// The joints between the cores of all bodies, body by body.
    #[doc(hidden)]
    pub fn joints(&self) -> &[Joint] {
        &self.model.joints
    }

    /// The contact patches (areas with one normal each) of all pairs of bodies and the contacts of the last step, as
    /// the GPU left them; empty where nothing can touch. A contact that was released, because it would have pulled, has
    /// stiffness 0. Positions are relative to the origin that was chosen for that step. This costs transfers from the
    /// GPU and is meant for tests and export.
    #[doc(hidden)]
    pub fn touch(&self) -> Result<(Vec<ContactPatch>, Vec<shaders::Contact>)> {
        let Some(touch) = &self.stages.touch else { return Ok((Vec::new(), Vec::new())) };
        Ok((touch.cull.contact_patches.read::<ContactPatch>()?, self.gpu_contacts()?))
    }

    /// The contacts of the last step as the GPU has them, those that were released included.
    fn gpu_contacts(&self) -> Result<Vec<shaders::Contact>> {
        let Some(touch) = &self.stages.touch else { return Ok(Vec::new()) };
        let count = self.stages.common.counts.read::<Counts>()?[0].contacts as usize;
        touch.contact.touch.contacts.read_first(count)
    }

    /// World position to which f32 positions on the GPU are relative: the tool's centre, where contact needs precision,
    /// or without a tool the centre of the first body's frame.
    fn origin(&self) -> DVec3 {
        let first = self.model.frames.first().map_or(DVec3::ZERO, |_| self.frames.place(0).centre);
        self.tool.as_ref().map_or(first, |tool| tool.centre)
    }

    /// Whether a haptic loop moves the tool, whose weight it then compensates.
    fn is_in_haptic_loop(&self) -> bool {
        !self.has_weight
    }

    /// Writes the inputs of a step of `h` seconds that ends at `time`, s.
    fn write_inputs(&self, time: f64, h: f64, device: &RigidState) -> Result<()> {
        let (step, origin) = (&self.scene.step, self.origin());
        let mut params = StepParams {
            dt: h as f32,
            tolerance: self.scene.solver.tolerance.unwrap_or(TIGHTEST) as f32,
            loosest: self.scene.solver.tolerance.unwrap_or(LOOSEST) as f32,
            max_iterations: self.scene.solver.max_iterations,
            newton: step.newton,
            gravity: step.gravity.as_vec3().to_array(),
            depth_limit: self.scene.contact.depth_limit as f32,
            texel: self.scene.contact.texel.unwrap_or(0.0) as f32,
            wants_stiffness: u32::from(self.is_in_haptic_loop()),
            friction: self.model.friction[0],
            friction_speed: self.model.friction[1],
            ..bytemuck::Zeroable::zeroed()
        };
        if let Some(tool) = &self.tool {
            let device = &tool.within_reach(device, self.max_force);
            if let Some(core) = self.model.tool_core() {
                let carried = if self.has_weight { DVec3::ZERO } else { h * self.tool_core_mass * step.gravity };
                params.held[0] = tools::held_core(tool, core, device, carried, h, origin);
            } else {
                let gravity = if self.has_weight { step.gravity } else { DVec3::ZERO };
                let rows = tool.rows(h, gravity, device);
                params.tool_matrix = std::array::from_fn(|k| rows.matrix[k / 6][k % 6] as f32);
                params.tool_rhs = rows.rhs.map(|x| x as f32);
            }
            let (v, w) = (tool.velocity, tool.angular_velocity);
            params.tool_twist = [v.x, v.y, v.z, w.x, w.y, w.z].map(|x| x as f32);
            params.tool_centre = (tool.centre - origin).as_vec3().to_array();
        }
        for (held, tool) in params.held[1..].iter_mut().zip(&self.further_tools) {
            *held = tool.held_core(time, h, step.gravity, origin);
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

    /// The report of a step that ended at `time` and was `h` seconds long.
    fn row(
        &self,
        report: &Report,
        (time, h): (f64, f64),
        device: &RigidState,
        probes: Vec<DVec3>,
        begun: Instant,
    ) -> StepReport {
        let touch = self.stages.touch.is_some();
        StepReport {
            step: self.step,
            time,
            tool: self.tool.as_ref().map(|tool| tools::tool_report(tool, device, &report.tools[0])),
            further_tools: (self.further_tools.iter().enumerate())
                .map(|(index, tool)| tool.report(time, h, report, index))
                .collect(),
            contacts: touch.then_some(report.contacts),
            max_depth: touch.then_some(f64::from(report.max_depth)),
            normal_turn: touch.then_some(f64::from(report.turn)),
            iterations: report.iterations,
            residual: f64::from(report.residual),
            nonlinear_residual: (self.scene.step.newton > 1 && !Flags(report.flags).contains(Flags::FROZEN))
                .then_some(f64::from(report.nonlinear_residual)),
            flags: Flags(report.flags),
            parts: self.last_parts,
            step_us: begun.elapsed().as_secs_f64() * 1e6,
            work: self.last_work,
            probes,
            reactions: self.last_reactions.clone(),
        }
    }
}
