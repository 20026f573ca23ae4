//! Makes a simulation of a scene, before its first step: prepares the bodies (computes on the host all that the GPU
//! needs to know about them), opens a GPU, and records the command buffers of a step. A stage is a part of a step; the
//! stages from the first one, pose, to the stage contact find where bodies touch. A layer is the tetrahedral mesh of a
//! soft body.

use crate::shaders;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::algorithm::Recordings;
use super::frames::Frames;
use super::passing::Passing;
use super::probes::{ProbePlace, probes_of};
use super::stage_set::Stages;
use super::tools::HeldTool;
use super::{Simulation, StepWork, TIMED_EVERY, Timing, tools};
use crate::gpu::{Context, Level, Options, Recorder, Threads};
use crate::plan::Plan;
use crate::prepare::bodies::Bodies;
use crate::prepare::{Body, Cache, Shape};
use crate::query::arrays::ArrayChoice;
use crate::query::choice::Choice;
use crate::scene::{self, Key, Operator, Scene};
use crate::stages::model::Model;
use crate::stages::query_as_one;
use crate::step::tool::Tool;
use crate::step::trajectory::Trajectory;
use crate::{Error, Result, memory};

/// Number of tetrahedra below which a Vulkan device that is a CPU is faster on the calling thread alone than with
/// worker threads, which it would have to wake for each pass (docs/evidence/benchmarks.md).
const LITTLE_WORK: usize = 10_000;

/// Number of tetrahedra into which each cell of a layer is cut, where the scene gives the layer as a box of cuboid
/// cells.
const KUHN_TETRAHEDRA: u64 = 6;
/// Size of the operator's 3x3 blocks for each tetrahedron of such a layer, bytes: 48 for each of the two blocks of each of
/// the seven edges of a cell. They form the largest array that layers need.
const BLOCKS_BYTES: u64 = 112;
/// Size of a tetrahedron's gradients, bytes, which form the largest array where the operator is matrix-free.
const GRADIENTS_BYTES: u64 = 80;

/// Remedy where the host's memory is too small.
const LESS: &str = "give coarser layers (a larger layer.cell), or free memory";

/// The parts of a simulation that are made before a GPU is opened.
struct Prepared {
    bodies: Vec<Body>,
    tool_body: Option<Body>,
    model: Model,
    frames: Frames,
    tool: Option<Tool>,
    further_tools: Vec<HeldTool>,
    probes: Vec<ProbePlace>,
    probe_nodes: Vec<[u32; 4]>,
}

impl Simulation {
    /// Prepares the scene's bodies, opens a GPU and records the step. All input is read before the GPU is opened. Only
    /// where `options` ask for it does this function measure the GPU's speed, keep files on disk or set environment
    /// variables.
    ///
    /// # Errors
    /// A file or a key of the scene is wrong ([`Error::Input`], [`Error::Key`]); [`Error::NoDevice`],
    /// [`Error::Memory`], [`Error::Vulkan`].
    pub fn open(scene: &Scene, options: &Options) -> Result<Simulation> {
        let cache = options.cache.as_deref().map_or_else(Cache::off, Cache::at);
        let prepared = Prepared::of(scene, Bodies::prepare(scene, &cache)?)?;
        let little = prepared.model.tetrahedra.len() < LITTLE_WORK;
        let threads = match options.threads {
            Some(Threads::Auto) if little => Some(Threads::Count(0)),
            other => other,
        };
        let context = Context::open(&Options { threads, ..options.clone() })?;
        prepared.record(scene, &context)
    }

    /// Prepares the scene's bodies and records the step on a GPU that is open already and may run other simulations
    /// too.
    ///
    /// # Errors
    /// The errors of [`Simulation::open`], except [`Error::NoDevice`].
    pub fn on_device(context: &Arc<Context>, scene: &Scene) -> Result<Simulation> {
        Simulation::check_room(context, scene)?;
        Prepared::of(scene, Bodies::prepare(scene, &Cache::of(context))?)?.record(scene, context)
    }

    /// Records the step of a scene whose bodies are all prepared already, on a GPU that is open.
    #[doc(hidden)]
    pub fn with_bodies(context: &Arc<Context>, scene: &Scene, bodies: Bodies) -> Result<Simulation> {
        Prepared::of(scene, bodies)?.record(scene, context)
    }
}

impl Simulation {
    /// Checks that the GPU can hold the layers that a scene gives as boxes, and returns [`Error::Memory`] if it cannot.
    /// The sizes of these layers are known before they are made: a box may easily have so many cells that not even the
    /// host's memory would hold its layer.
    #[doc(hidden)]
    pub fn check_room(context: &Context, scene: &Scene) -> Result<()> {
        let count = |body: &scene::Body| match body.shape {
            scene::Shape::Soft { layer: scene::Layer::Box { cells, .. }, .. } => {
                cells.iter().fold(KUHN_TETRAHEDRA, |product, cells| product.saturating_mul(u64::from(*cells)))
            }
            _ => 0,
        };
        let tetrahedra = scene.bodies.iter().map(count).fold(0, u64::saturating_add);
        let (what, bytes, remedy) = match scene.solver.operator {
            Operator::Auto => ("operator", BLOCKS_BYTES, ", or solver.operator = \"matrix-free\""),
            Operator::MatrixFree => ("gradients", GRADIENTS_BYTES, ""),
        };
        let (needed, (most, _)) = (tetrahedra.saturating_mul(bytes), context.array_limits());
        if needed <= most {
            return Ok(());
        }
        let device = context.device_name();
        Err(Error::Memory(format!(
            "{what} of the {tetrahedra} tetrahedra in layers given as boxes: {needed} bytes are needed, but a storage \
             buffer of {device} holds at most {most} bytes; use fewer cells{remedy}"
        )))
    }
}

impl Prepared {
    fn of(scene: &Scene, Bodies { bodies, tool: tool_body }: Bodies) -> Result<Prepared> {
        scene.check_filled()?;
        let count = |body: &Body| if let Shape::Soft { layer, .. } = &body.shape { layer.tetrahedra.len() } else { 0 };
        let tetrahedra: usize = bodies.iter().map(count).sum();
        memory::ask(memory::BYTES_PER_TETRAHEDRON * tetrahedra as f64)
            .map_err(|problem| Error::key(&scene.file, "body", format!("{tetrahedra} tetrahedra: {problem}"), LESS))?;
        let model = Model::new(scene, &bodies, tool_body.as_ref());
        let frames = Frames::new(&model, |frame| velocity_of(&bodies, &model, frame));
        let tool = tools::tool_of(scene, tool_body.as_ref(), &model, &frames)?;
        let further_tools = HeldTool::all_of(scene, &model, &frames)?;
        let (probes, probe_nodes) = probes_of(scene, &bodies, &model)?;
        Ok(Prepared { bodies, tool_body, model, frames, tool, further_tools, probes, probe_nodes })
    }

    fn record(self, scene: &Scene, context: &Arc<Context>) -> Result<Simulation> {
        let Prepared { bodies, tool_body, model, frames, tool, further_tools, probes, probe_nodes } = self;
        let arrays = ArrayChoice::new(context)?;
        let choice = if model.needs_depth() { Some(Choice::new(context, scene.contact.depth)?) } else { None };
        let path = choice.as_ref().map(|choice| choice.path);
        let of_files = bodies.iter().chain(&tool_body).flat_map(|body| body.report.notes.iter().cloned());
        scene.notes().into_iter().chain(of_files).for_each(|note| context.tell(Level::Note, &note));
        context.tell(Level::Note, &format!("arrays: {arrays}"));
        choice.iter().for_each(|choice| context.tell(Level::Note, &format!("depth stage: {choice}")));
        let stages = Stages::new(context, &model, path, &probe_nodes)?;
        // Some drivers compile a kernel at its first dispatch; this submission makes them compile here, and not in the
        // first step.
        Recordings::new(&stages, 0, || Recorder::warm_up(context))?.submit_once()?;
        let plain = Recordings::new(&stages, scene.solver.max_iterations, || Recorder::untimed(context))?;
        let timing = Timing::Stages;
        let timed = timed(context, &stages, scene, timing)?;
        let start = tool.as_ref().map_or((DVec3::ZERO, DQuat::IDENTITY), |t| (t.centre, t.orientation));
        let plan = Plan::new(scene, &model, choice.map(|choice| choice.to_string()));
        let tool_core_mass = tools::tool_core_mass(&model);
        Ok(Simulation {
            has_friction: model.friction[0] > 0.0,
            passing: Passing::new(&model),
            tool_end: None,
            trajectory: Trajectory::new(&scene.trajectory, Key { time: 0.0, position: start.0, orientation: start.1 }),
            scene: scene.clone(),
            context: Arc::clone(context),
            bodies,
            tool_body,
            model,
            stages,
            plain,
            timing,
            timed,
            tool,
            further_tools,
            frames,
            probes,
            plan,
            kind_of_arrays: arrays.to_string(),
            path,
            step: 0,
            time: 0.0,
            has_weight: true,
            tool_core_mass,
            max_force: f64::INFINITY,
            last_wrench: None,
            last_reactions: Vec::new(),
            last_iterations: 0,
            needs: Default::default(),
            last_work: StepWork::default(),
            last_parts: 1,
            last_timed: None,
            pass_counts: Vec::new(),
            timed_every: TIMED_EVERY,
            is_solved: false,
            step_origin: DVec3::ZERO,
            cuts: Default::default(),
            shown: None,
        })
    }
}

/// The sets of recordings of the step with timestamps, one for each kind of step that is timed.
pub(super) fn timed(context: &Arc<Context>, stages: &Stages, scene: &Scene, timing: Timing) -> Result<Vec<Recordings>> {
    let record =
        |recorder: &dyn Fn() -> Result<Recorder>| Recordings::new(stages, scene.solver.max_iterations, recorder);
    match timing {
        Timing::Nothing => Ok(Vec::new()),
        Timing::Stages => {
            Ok(vec![record(&|| Recorder::new(context))?, record(&|| Recorder::timed_by(context, query_as_one))?])
        }
        Timing::Passes => Ok(vec![record(&|| Recorder::timed_by_pass(context))?]),
    }
}

/// The initial velocity of the body that a rigid coordinate frame belongs to, m/s.
fn velocity_of(bodies: &[Body], model: &Model, frame: usize) -> DVec3 {
    let owner = model.body_frames.iter().rposition(|&first| first != shaders::NONE && first as usize <= frame);
    owner.and_then(|body| bodies.get(body)).map_or(DVec3::ZERO, |body| body.velocity)
}
