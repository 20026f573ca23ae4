//! The stages of the step: a file a stage, each with its kernels, its arrays, and a `record` that names its passes.
//!
//! Sizes are in elements; `texels` arrays are read through texel buffer views, `words` through storage buffers.

mod blocks;
mod chunks;
mod clusters;
pub mod coarse;
pub mod contact;
pub mod contact_law;
pub mod cull;
pub mod depth;
pub mod dilate;
pub mod draw;
pub mod elastic;
mod flags;
pub mod gap;
pub mod joints;
mod layers;
pub mod material_law;
pub mod model;
mod pairs;
pub mod pose;
pub mod skin;
pub mod solve;
pub mod touch;
pub mod wrench;

use std::sync::Arc;

use bytemuck::Pod;

use crate::Result;
use crate::gpu::{Buffer, Const, Context, Memory};
use crate::shaders::{self, Counts, Frame, Joint, Link, Report, StepParams};
pub use flags::Flags;
use model::Model;

/// Vertices of a chunk at most.
pub const CHUNK_VERTICES: usize = shaders::CHUNK_VERTICES as usize;
/// Triangles of a chunk at most.
pub const CHUNK_TRIANGLES: usize = shaders::CHUNK_TRIANGLES as usize;
/// Regions that a pair of bodies can have.
pub const PAIR_REGIONS: usize = shaders::PAIR_REGIONS as usize;
/// Words of the indirect arguments.
pub const ARGS_WORDS: usize = shaders::ARGS_WORDS as usize;

/// The stages of the proximity query, in their order.
pub const QUERY: [&str; 5] = ["pose", "cull", "skin", "depth", "contact"];

/// The timer of [`QUERY`] where those stages are timed as one.
pub const POSE_TO_CONTACT: &str = "pose to contact";

/// Which timer a stage counts for where the query's stages are timed as one: see [`crate::gpu::Recorder::timed_by`].
pub fn query_as_one(stage: &str) -> &str {
    if QUERY.contains(&stage) { POSE_TO_CONTACT } else { stage }
}

/// What every stage shares: the host's inputs and outputs, counters, indirect arguments.
pub struct Common {
    /// One [`StepParams`].
    pub params: Buffer,
    /// A [`Frame`] a frame of the model.
    pub frames: Buffer,
    /// A [`Joint`] a joint of the model.
    pub joints: Buffer,
    /// A [`Link`] a pair of frames that something spans.
    pub links: Buffer,
    /// One [`Counts`].
    pub counts: Buffer,
    /// Slots of `shaders/shared/args.glsl`.
    pub args: Buffer,
    /// One [`Report`].
    pub report: Buffer,
}

impl Common {
    /// Arrays for a model; counters and arguments zero.
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
}

/// A device array with these contents.
fn upload<T: Pod>(context: &Arc<Context>, name: &str, data: &[T]) -> Result<Buffer> {
    Buffer::from_slice(context, name, data, Memory::Device)
}

/// A device array of `count` elements, uninitialised.
fn array<T: Pod>(context: &Arc<Context>, name: &str, count: usize) -> Result<Buffer> {
    Buffer::new(context, name, (count.max(1) * size_of::<T>()) as u64, Memory::Device)
}

/// A device array of `count` zeros.
fn zeros<T: Pod>(context: &Arc<Context>, name: &str, count: usize) -> Result<Buffer> {
    upload(context, name, &vec![T::zeroed(); count.max(1)])
}

/// A count as a specialization constant; counts fit, since arrays of 2^32 elements are refused before.
fn count(value: usize) -> Const {
    Const::Uint(value as u32)
}
