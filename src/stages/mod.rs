//! The stages of the step: one file per stage, with its kernels, its arrays, and a function `record` that records its
//! passes into a command buffer.
//!
//! Lengths of arrays are in elements. Read-only arrays of vectors are bound as texel buffers or as storage buffers;
//! which of the two is a choice per GPU (shaders/shared/arrays.glsl). A core is a rigid body inside a soft one, dynamic
//! if forces move it; a frame is a rigid coordinate frame; a ray hit is a point where a skin vertex's ray meets a
//! triangle of the other body; the tool is the rigid body that the haptic device leads; a probe is a vertex whose path
//! is recorded.

mod aggregates;
mod blocks;
mod chunks;
pub mod coarse;
pub mod contact;
pub mod contact_law;
pub mod cull;
pub mod depth;
pub mod draw;
pub mod edges;
pub mod elastic;
mod flags;
pub mod gap;
pub mod joints;
mod layers;
pub mod loads;
pub mod material_law;
pub mod mean_dilatation;
pub mod model;
pub mod overlaps;
mod pairs;
pub mod pose;
pub mod samples;
pub mod skin;
pub mod solve;
pub mod supports;
pub mod tips;
pub mod touch;
pub mod wrench;

use std::sync::Arc;

use bytemuck::Pod;

use crate::Result;
use crate::gpu::{Buffer, Const, Context, Memory, Recorder};
use crate::scene::Scene;
use crate::shaders::{self, Counts, Frame, Joint, Link, Report, StepParams};
pub use flags::{Explanation, Flags};
use model::Model;

/// Largest number of vertices of a chunk, a group of skin vertices and triangles that is culled as a whole.
pub const CHUNK_VERTICES: usize = shaders::CHUNK_VERTICES as usize;
/// Largest number of triangles of a chunk.
pub const CHUNK_TRIANGLES: usize = shaders::CHUNK_TRIANGLES as usize;
/// Largest number of contact patches (areas with one normal each, where two bodies may touch) of a pair of bodies.
pub const PAIR_PATCHES: usize = shaders::PAIR_PATCHES as usize;
/// Length of the array of indirect arguments, in 32-bit words.
pub const ARGS_WORDS: usize = shaders::ARGS_WORDS as usize;

/// The stages that find contact, in the order in which they run. The proximity query (contact between two rigid bodies,
/// without forces) consists of these stages alone.
pub const QUERY: [&str; 5] = ["pose", "cull", "skin", "depth", "contact"];

/// Name of the timer for all stages of [`QUERY`] together, where they are timed as one.
pub const POSE_TO_CONTACT: &str = "pose to contact";

/// Name of the timer to which a stage's time is added where the query's stages are timed as one: see
/// [`crate::gpu::Recorder::timed_by`].
pub fn query_as_one(stage: &str) -> &str {
    if QUERY.contains(&stage) { POSE_TO_CONTACT } else { stage }
}

/// Whether a scene needs a stage of the step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageNeed {
    /// Name of the stage.
    pub stage: &'static str,
    /// Whether the stage is recorded (and its arrays are allocated).
    pub recorded: bool,
    /// Why the stage is recorded, or why it is left out.
    pub reason: String,
}

/// Which stages a scene needs, and why. `depth`: which path the depth stage takes (graphics or compute) and why; `None`
/// where the depth stage is left out.
pub fn needs(scene: &Scene, model: &Model, depth: Option<String>) -> Vec<StageNeed> {
    let touches = !model.pairs.is_empty();
    let nothing = match (&scene.tool, scene.bodies.len()) {
        (None, 0 | 1) => "a single body and no tool: nothing to touch",
        (None, _) => "no tool, and no two bodies that may touch",
        (Some(_), _) => "no body may touch the tool or another body",
    };
    let planes = "only half-spaces are touched: their depth needs no ray hits";
    let overlaps = model.pairs.iter().filter(|pair| pair.by_triangles != 0).count();
    let overlaps = (overlaps > 0).then(|| format!("{overlaps} pairs of bodies by the overlaps of triangles"));
    let depth: Vec<String> = depth.into_iter().chain(overlaps).collect();
    let pairs: String = match model.pairs.len() {
        1 => "1 pair of bodies may touch".into(),
        count => format!("{count} pairs of bodies may touch"),
    };
    let mut entries = Vec::new();
    let mut add = |stage, recorded, yes: String, no: &str| {
        entries.push(StageNeed { stage, recorded, reason: if recorded { yes } else { no.into() } });
    };
    let (attached, floating) = (model.attached_nodes.len(), model.floating.len());
    let pose = if touches { pairs.clone() } else { format!("{attached} nodes attached to moving coordinate frames") };
    add("pose", touches || attached > 0, pose, nothing);
    add("skin", touches, pairs.clone(), nothing);
    add("cull", touches, pairs.clone(), nothing);
    add("depth", !depth.is_empty(), depth.join("; "), if touches { planes } else { nothing });
    add("contact", touches, pairs, nothing);
    let soft = !model.tetrahedra.is_empty();
    let times = if model.newton > 1 { format!(", {} Newton iterations", model.newton) } else { String::new() };
    add("elastic", soft, format!("{} tetrahedra{times}", model.tetrahedra.len()), "no soft body");
    let solve = match model.cores.len() {
        0 => format!("{} nodes", model.node_rest.len()),
        cores => format!("{} nodes, {cores} dynamic cores", model.node_rest.len()),
    };
    let solve = match model.joints.len() {
        0 => solve,
        joints => format!("{solve}, {joints} joints"),
    };
    // The coarse level is the coarse space of the solver's preconditioner, an aggregate one of its blocks of free
    // nodes; the stiffness number is the ratio of a node's stiffness to its inertia in a step.
    let coarse = |(body, number, aggregates): &(usize, f64, usize)| {
        let name = scene.bodies.get(*body).map_or("", |body| &body.name);
        format!(", coarse level of `{name}`: stiffness number {number:.0}, {aggregates} aggregates")
    };
    let solve = solve + &model.coarse.bodies.iter().map(coarse).collect::<String>();
    add("solve", true, solve, "");
    let wrench = touches && scene.tool.is_some();
    add("wrench", wrench, "net wrench on the tool".into(), if scene.tool.is_some() { nothing } else { "no tool" });
    add(
        "fit",
        floating > 0,
        format!("{floating} soft bodies without a core"),
        "every soft body has a core or supports",
    );
    add("probe", !scene.probes.is_empty(), format!("{} vertices", scene.probes.len()), "no probes");
    entries
}

/// Arrays that all stages share: the host's inputs and outputs, counters, indirect arguments.
pub struct Common {
    /// The step's parameters, one [`StepParams`].
    pub params: Buffer,
    /// One [`Frame`] (rigid coordinate frame) per frame of the model.
    pub frames: Buffer,
    /// One [`Joint`] per joint of the model.
    pub joints: Buffer,
    /// One [`Link`] per pair of frames in both of which a tetrahedron, collision proxy (convex hull over a part of a
    /// skin) or chunk has nodes: the placement of one frame relative to the other.
    pub links: Buffer,
    /// Counters and flags of the step, one [`Counts`].
    pub counts: Buffer,
    /// Indirect arguments; shaders/shared/args.glsl names their places.
    pub args: Buffer,
    /// What the host reads after the step, one [`Report`].
    pub report: Buffer,
}

impl Common {
    /// Arrays for a model; counters and arguments are zero.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Common> {
        let frames = model.frames.len().max(1) * size_of::<Frame>();
        let joints = model.joints.len().max(1) * size_of::<Joint>();
        Ok(Common {
            params: Buffer::new(context, "params", size_of::<StepParams>() as u64, Memory::Upload)?,
            frames: Buffer::new(context, "frames", frames as u64, Memory::Upload)?,
            joints: Buffer::new(context, "joints", joints as u64, Memory::Upload)?,
            links: Buffer::new(context, "links", (model.links.len() * size_of::<Link>()) as u64, Memory::Upload)?,
            counts: zeros::<Counts>(context, "counts", 1)?,
            args: zeros::<u32>(context, "args", ARGS_WORDS)?,
            report: Buffer::new(context, "report", size_of::<Report>() as u64, Memory::Readback)?,
        })
    }

    /// Records the copies of what the host wrote for the step, where kernels cannot read it in place.
    pub fn record_inputs(&self, recorder: &mut Recorder) {
        if self.params.memory() == Memory::Upload {
            return;
        }
        recorder.stage("solve");
        for array in [&self.params, &self.frames, &self.joints, &self.links] {
            recorder.upload(array);
        }
    }
}

/// An array in GPU memory with these contents.
fn upload<T: Pod>(context: &Arc<Context>, name: &str, data: &[T]) -> Result<Buffer> {
    Buffer::from_slice(context, name, data, Memory::Device)
}

/// These numbers and zeros, a multiple of four of them, at least four: texels of four.
fn whole_texels(numbers: &[u32]) -> Vec<u32> {
    let mut texels = numbers.to_vec();
    texels.resize(numbers.len().next_multiple_of(4).max(4), 0);
    texels
}

/// An array in GPU memory with these contents, or, where there are none, a single zero that no kernel reads.
fn upload_or_nothing<T: Pod>(context: &Arc<Context>, name: &str, data: &[T]) -> Result<Buffer> {
    if data.is_empty() { zeros::<T>(context, name, 1) } else { upload(context, name, data) }
}

/// An array in GPU memory of `count` elements, uninitialised.
fn array<T: Pod>(context: &Arc<Context>, name: &str, count: usize) -> Result<Buffer> {
    Buffer::new(context, name, (count.max(1) * size_of::<T>()) as u64, Memory::Device)
}

/// An array in GPU memory of `count` zeroed elements.
fn zeros<T: Pod>(context: &Arc<Context>, name: &str, count: usize) -> Result<Buffer> {
    upload(context, name, &vec![T::zeroed(); count.max(1)])
}

/// A count as a specialization constant; it fits, since arrays of 2^32 elements are refused earlier.
fn count(value: usize) -> Const {
    Const::Uint(value as u32)
}
