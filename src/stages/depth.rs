//! Depth stage (narrow phase), before the contact stage of a step: finds where triangles of one body's skin (surface
//! mesh) hit the rays that the other body's skin vertices cast along a contact patch's normal. A contact patch is an
//! area with one normal where two bodies may touch. The stage has two interchangeable implementations (paths), graphics
//! and compute, which find the same hits; both look up vertices in a spatial hash, which lists them by cell of the
//! patch's plane. A chunk is a group of at most 64 skin vertices with their triangles; it is active if it may meet the
//! other body.

use std::sync::Arc;

use super::cull::{Cull, MOST_CELLS};
use super::model::Model;
use super::skin::{self, Skin};
use super::{Common, array, count};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, RasterPipeline, Recorder, Size};
use crate::shaders;
use crate::stages::CHUNK_VERTICES;

pub use crate::scene::DepthPath as Path;

/// Name of the stage in timers and reports.
pub const STAGE: &str = "depth";
/// Least capacity for ray hits; between this value and `MOST_HITS` the capacity grows with the number of skin vertices.
const LEAST_HITS: usize = 1 << 16;
/// Greatest capacity for ray hits.
const MOST_HITS: usize = 1 << 20;

/// Index of the draw's arguments in the array of indirect arguments, in units of VkDrawIndirectCommand (four words).
const DRAW: u32 = 3 * shaders::ARGS_DRAW / 4;
/// Pixels along a side of the graphics path's viewport, one pixel per cell of the spatial hash.
const RASTER_CELLS: u32 = MOST_CELLS + 1;

/// Pipeline and arrays of the depth stage.
pub struct Depth {
    cross: RayHitKernel,
    /// One per ray hit: index of the triangle, index of the next hit on the same ray, bits of the depth (f32, m), and
    /// twice the index of the triangle's work item (an active chunk in a contact patch), plus 1 where the ray hits the
    /// triangle's front.
    pub hits: Buffer,
}

/// The pipeline that finds the cells of the spatial hash that each triangle covers, and the ray hits there: the
/// rasterizer, or a compute kernel that loops over the cells.
enum RayHitKernel {
    Graphics(RasterPipeline),
    Compute(Kernel),
}

impl Depth {
    /// Kernels and arrays for a model. The graphics path needs the device feature [`Context::fragment_stores`].
    pub fn new(context: &Arc<Context>, model: &Model, path: Path) -> Result<Depth> {
        let hits = (2 * CHUNK_VERTICES * model.max_gathering_work_items()).clamp(LEAST_HITS, MOST_HITS);
        let constants = [
            ("BUCKETS", skin::buckets(model).into()),
            ("MOST_HITS", count(hits)),
            ("RASTER_CELLS", RASTER_CELLS.into()),
        ];
        let cross = match path {
            Path::Graphics => RayHitKernel::Graphics(RasterPipeline::new(context, "depth/ray_hits", &constants)?),
            Path::Compute => {
                RayHitKernel::Compute(Kernel::new(context, "depth/ray_hits", Size::Reduce, &constants[..2])?)
            }
        };
        Ok(Depth { cross, hits: array::<[u32; 4]>(context, "hits", hits)? })
    }

    /// Records one pass, with a workgroup (compute) or an instance of the draw (graphics) per work item, which is an
    /// active chunk in one contact patch.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, cull: &Cull, skin: &Skin) {
        recorder.stage(STAGE);
        let arguments = shaders::depth::RayHits {
            counts: &common.counts,
            work_items: &cull.work_items,
            active_chunks: &cull.active_chunks,
            chunks: &cull.chunks,
            chunk_triangles: &skin.chunk_triangles,
            contact_patches: &cull.contact_patches,
            triangles: &skin.triangles,
            skin: &skin.skin,
            buckets: &skin.buckets,
            hash_entries: &skin.hash_entries,
            entry_cells: &skin.entry_cells,
            entry_hits: &skin.entry_hits,
            hits: &self.hits,
            pairs: &cull.pairs,
        };
        match &self.cross {
            RayHitKernel::Graphics(cross) => {
                recorder.draw_indirect(cross, &arguments, &common.args, DRAW, RASTER_CELLS)
            }
            RayHitKernel::Compute(cross) => {
                recorder.dispatch_indirect(cross, &arguments, &common.args, shaders::ARGS_WORK_ITEMS)
            }
        }
    }
}
