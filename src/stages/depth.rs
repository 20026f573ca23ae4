//! Depth: where triangles of one side cross the rays of the other side's vertices. Two interchangeable paths.

use std::sync::Arc;

use super::cull::Cull;
use super::model::Model;
use super::skin::{BUCKETS, Skin};
use super::types::CHUNK_VERTICES;
use super::{Common, args, array, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, DeviceKind, Kernel, Recorder, Size};

/// How triangles find the vertices that they lie over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// The graphics pipeline's rasterizer.
    Graphics,
    /// Loops in compute.
    Compute,
}

impl Path {
    /// Graphics on a GPU; compute on a CPU device, whose rasterizer pays for every triangle.
    pub fn of(kind: DeviceKind) -> Path {
        if kind == DeviceKind::Cpu { Path::Compute } else { Path::Graphics }
    }

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Path::Graphics => "graphics",
            Path::Compute => "compute",
        }
    }
}

/// Crossings at least; more where the scene has more vertices.
const LEAST_HITS: usize = 1 << 16;
const MOST_HITS: usize = 1 << 20;

/// Crossings of all regions.
pub struct Depth {
    cross: Kernel,
    chunk_triangles: Buffer,
    /// Triangle, next on the same ray, bits of the depth, whether it is a front.
    pub hits: Buffer,
}

impl Depth {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model, _path: Path) -> Result<Depth> {
        let hits = (2 * CHUNK_VERTICES * model.most_items()).clamp(LEAST_HITS, MOST_HITS);
        let constants = [("BUCKETS", BUCKETS.into()), ("MOST_HITS", count(hits))];
        Ok(Depth {
            cross: Kernel::new(context, "depth/cross", Size::Reduce, &constants)?,
            chunk_triangles: upload(context, "triangles of chunks", &model.chunk_triangles)?,
            hits: array::<[u32; 4]>(context, "crossings", hits)?,
        })
    }

    /// One pass: a workgroup an active chunk and region.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, cull: &Cull, skin: &Skin) {
        recorder.stage("depth");
        let buffers = [
            &common.counts,
            &cull.items,
            &cull.active_chunks,
            &cull.chunks,
            &self.chunk_triangles,
            &cull.regions,
            &skin.triangles,
            &skin.skin,
            &skin.buckets,
            &skin.bins,
            &skin.bin_sides,
            &skin.bin_hits,
            &self.hits,
            &cull.fields,
        ];
        recorder.dispatch_indirect(&self.cross, &buffers, &[], &common.args, args::ITEMS);
    }
}
