//! Skin: where the skin of active chunks is, binned for the depth stage; and the probed vertices.

use std::sync::Arc;

use super::cull::{Cull, FIELD_WORDS};
use super::elastic::Elastic;
use super::model::Model;
use super::pose::Pose;
use super::{Common, array, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::stages::{CHUNK_VERTICES, PAIR_REGIONS};

/// Heads of the hash table that holds binned vertices, at least.
pub const LEAST_BUCKETS: u32 = 1 << 13;

/// Heads of that table: one for four skin vertices, so that lists stay short where bodies coincide, and it is cleared in
/// microseconds.
pub fn buckets(model: &Model) -> u32 {
    (model.skin_nodes.len() as u32 / 4).next_power_of_two().max(LEAST_BUCKETS)
}

/// The table's words: its heads, and for each region's two sides how far back the vertices in it look.
fn bucket_words(model: &Model) -> u32 {
    buckets(model) + (PAIR_REGIONS * model.pairs.len() * FIELD_WORDS) as u32
}

/// Topology and embedding of all skins, and their positions this step.
pub struct Skin {
    embed: Kernel,
    /// Skin vertices, by chunk.
    pub chunk_vertices: Buffer,
    /// Four nodes a skin vertex.
    pub skin_nodes: Buffer,
    /// Four weights, or the position on a rigid body.
    pub skin_weights: Buffer,
    /// Positions; of active chunks only.
    pub skin: Buffer,
    /// Three skin vertices a triangle.
    pub triangles: Buffer,
    /// First vertex of each bucket; then how far back vertices look, see shaders/shared/bins.glsl.
    pub buckets: Buffer,
    /// A vertex in a region: position along its axes, the next of its bucket.
    pub bins: Buffer,
    /// First crossing found on the ray of each.
    pub bin_hits: Buffer,
    /// 2 * region + side, and square, of each.
    pub bin_squares: Buffer,
}

impl Skin {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Skin> {
        let constants = [("SPANS", Const::Bool(model.spans_frames())), ("BUCKETS", buckets(model).into())];
        let bins = CHUNK_VERTICES * model.most_gathering_items();
        Ok(Skin {
            embed: Kernel::new(context, "skin/embed", Size::Reduce, &constants)?,
            chunk_vertices: upload(context, "chunk_vertices", &model.chunk_vertices)?,
            skin_nodes: upload(context, "skin_nodes", &model.skin_nodes)?,
            skin_weights: upload(context, "skin_weights", &model.skin_weights)?,
            skin: zeros::<[f32; 4]>(context, "skin", model.skin_nodes.len())?,
            triangles: upload(context, "triangles", &model.triangles)?,
            buckets: array::<u32>(context, "buckets", bucket_words(model) as usize)?,
            bins: array::<[u32; 4]>(context, "bins", bins)?,
            bin_hits: array::<u32>(context, "bin_hits", bins)?,
            bin_squares: array::<[u32; 2]>(context, "bin_squares", bins)?,
        })
    }

    /// The skin of active chunks: a workgroup each.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, cull: &Cull, elastic: &Elastic) {
        recorder.stage("skin");
        let arguments = shaders::skin::Embed {
            frames: &common.frames,
            active_chunks: &cull.active_chunks,
            pairs: &cull.pairs,
            slots: &cull.slots,
            proxies: &pose.proxies,
            chunks: &cull.chunks,
            chunk_vertices: &self.chunk_vertices,
            skin_nodes: &self.skin_nodes,
            skin_weights: &self.skin_weights,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            node_info: Some(&elastic.node_info),
            regions: &cull.regions,
            shares: &cull.shares,
            skin: &self.skin,
            buckets: &self.buckets,
            bins: &self.bins,
            bin_hits: &self.bin_hits,
            bin_squares: &self.bin_squares,
            fields: &cull.fields,
        };
        recorder.dispatch_indirect(&self.embed, &arguments, &common.args, shaders::ARGS_ACTIVE);
    }
}

/// Skin vertices that the host follows: their nodes' displacements, read after each step.
pub struct Probes {
    probe: Kernel,
    count: u32,
    nodes: Buffer,
    /// Four vec4 a probe: displacements of its nodes, each in its frame, m.
    pub displacement: Buffer,
}

impl Probes {
    /// Probes with their four nodes each.
    pub fn new(context: &Arc<Context>, nodes: &[[u32; 4]]) -> Result<Probes> {
        Ok(Probes {
            probe: Kernel::new(context, "skin/probe", Size::Group, &[("PROBE_NODES", count(4 * nodes.len()))])?,
            count: 4 * nodes.len() as u32,
            nodes: upload(context, "probe_nodes", nodes)?,
            displacement: Buffer::new(context, "probes", (64 * nodes.len()) as u64, Memory::Readback)?,
        })
    }

    /// One pass over the nodes of probes.
    pub fn record(&self, recorder: &mut Recorder, elastic: &Elastic) {
        recorder.stage("probe");
        recorder.dispatch(
            &self.probe,
            &shaders::skin::Probe {
                probe_nodes: &self.nodes,
                displacement: &elastic.displacement,
                probes: &self.displacement,
            },
            self.count,
        );
    }
}
