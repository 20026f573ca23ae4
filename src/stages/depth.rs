//! Depth: where triangles of one side cross the rays of the other side's vertices. Two interchangeable paths.

use std::sync::Arc;

use super::cull::{Cull, MOST_CELLS};
use super::model::Model;
use super::skin::{self, Skin};
use super::{Common, array, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, RasterPipeline, Recorder, Size};
use crate::shaders;
use crate::stages::CHUNK_VERTICES;

pub use crate::scene::DepthPath as Path;

/// Name of the stage.
pub const STAGE: &str = "depth";
/// Crossings at least; more where the scene has more vertices.
const LEAST_HITS: usize = 1 << 16;
const MOST_HITS: usize = 1 << 20;

/// Pixels a side of the graphics path, one a square.
/// Where the draw stands, counted in VkDrawIndirectCommands of four words.
const DRAW: u32 = 3 * shaders::ARGS_DRAW / 4;
const SQUARES: u32 = MOST_CELLS + 1;

/// Crossings of all regions.
pub struct Depth {
    cross: Cross,
    /// Triangles, by chunk.
    pub chunk_triangles: Buffer,
    /// Triangle, next on the same ray, bits of the depth, twice its work item and whether it is a front.
    pub hits: Buffer,
}

/// What shares out the squares that triangles cover.
enum Cross {
    Graphics(RasterPipeline),
    Compute(Kernel),
}

impl Depth {
    /// Kernels and arrays for a model. The graphics path needs [`Context::fragment_stores`].
    pub fn new(context: &Arc<Context>, model: &Model, path: Path) -> Result<Depth> {
        let hits = (2 * CHUNK_VERTICES * model.most_gathering_items()).clamp(LEAST_HITS, MOST_HITS);
        let constants =
            [("BUCKETS", skin::buckets(model).into()), ("MOST_HITS", count(hits)), ("SQUARES", SQUARES.into())];
        let cross = match path {
            Path::Graphics => Cross::Graphics(RasterPipeline::new(context, "depth/cross", &constants)?),
            Path::Compute => Cross::Compute(Kernel::new(context, "depth/cross", Size::Reduce, &constants[..2])?),
        };
        Ok(Depth {
            cross,
            chunk_triangles: upload(context, "chunk_triangles", &model.chunk_triangles)?,
            hits: array::<[u32; 4]>(context, "hits", hits)?,
        })
    }

    /// One pass: a workgroup, or an instance of the draw, an active chunk and region.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, cull: &Cull, skin: &Skin) {
        recorder.stage(STAGE);
        let arguments = shaders::depth::Cross {
            counts: &common.counts,
            items: &cull.items,
            active_chunks: &cull.active_chunks,
            chunks: &cull.chunks,
            chunk_triangles: &self.chunk_triangles,
            regions: &cull.regions,
            triangles: &skin.triangles,
            skin: &skin.skin,
            buckets: &skin.buckets,
            bins: &skin.bins,
            bin_squares: &skin.bin_squares,
            bin_hits: &skin.bin_hits,
            hits: &self.hits,
            pairs: &cull.pairs,
        };
        match &self.cross {
            Cross::Graphics(cross) => recorder.draw_indirect(cross, &arguments, &common.args, DRAW, SQUARES),
            Cross::Compute(cross) => recorder.dispatch_indirect(cross, &arguments, &common.args, shaders::ARGS_ITEMS),
        }
    }
}
