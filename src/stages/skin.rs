//! Skin stage, between the cull and the depth stage of a step: computes the positions of the skin (surface mesh) of
//! active chunks, which are groups of at most 64 skin vertices that may meet the other body. For the depth stage it
//! enters the vertices into a spatial hash, by cell of the plane of a contact patch (an area with one normal where two
//! bodies may touch). This file also reads the probes, skin vertices whose positions a scene records.

use std::sync::Arc;

use super::cull::{Cull, GRID_WORDS};
use super::elastic::Elastic;
use super::model::Model;
use super::pose::Pose;
use super::{Common, array, count, upload, whole_texels, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::stages::{CHUNK_VERTICES, PAIR_PATCHES};

/// Least number of buckets of the spatial hash.
pub const LEAST_BUCKETS: u32 = 1 << 13;

/// Number of buckets of the spatial hash: one per four skin vertices, so that the lists of vertices in the buckets stay
/// short even where bodies coincide, and the hash is still cleared in microseconds.
pub fn buckets(model: &Model) -> u32 {
    (model.skin_nodes.len() as u32 / 4).next_power_of_two().max(LEAST_BUCKETS)
}

/// Length in words of the array `buckets`: a list head per bucket, then two depth grids per contact patch, one for each
/// of its two bodies. A cell of a body's grid holds how far a triangle of the other body must reach along the patch's
/// normal to be hit by a ray of the body's vertices in that cell.
fn bucket_words(model: &Model) -> u32 {
    buckets(model) + (PAIR_PATCHES * model.pairs.len() * GRID_WORDS) as u32
}

/// Topology and embedding of all skins, and their positions in this step.
pub struct Skin {
    embed: Kernel,
    /// Skin vertices of the chunks, chunk by chunk.
    pub chunk_vertices: Buffer,
    /// Triangles of the chunks, chunk by chunk.
    pub chunk_triangles: Buffer,
    /// Per skin vertex: the four nodes of its tetrahedron; the first is `NONE` on a rigid body.
    pub skin_nodes: Buffer,
    /// Per skin vertex: its four embedding weights, or on a rigid body its position in the body's rigid coordinate
    /// frame (m).
    pub skin_weights: Buffer,
    /// Per skin vertex: its position relative to the origin that each step chooses near the tool, m; valid in active
    /// chunks only.
    pub skin: Buffer,
    /// Per triangle: its three skin vertices.
    pub triangles: Buffer,
    /// Per bucket of the spatial hash: index of the first entry of its list; after all buckets come the depth grids of
    /// the vertices (shaders/shared/spatial_hash.glsl).
    pub buckets: Buffer,
    /// The entries of the hash, one per vertex and contact patch: position along the patch's axes (m), next entry in
    /// the bucket.
    pub hash_entries: Buffer,
    /// Per entry of the hash: the head of its list of ray hits (points where the vertex's ray meets a triangle of the
    /// other body).
    pub entry_hits: Buffer,
    /// Per entry of the hash: 2 times the contact patch plus the side (0 for body a of the pair, 1 for b), and the cell
    /// of the hash.
    pub entry_cells: Buffer,
}

impl Skin {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Skin> {
        let constants = [("SPANS", Const::Bool(model.spans_frames())), ("BUCKETS", buckets(model).into())];
        let hash_entries = CHUNK_VERTICES * model.max_gathering_work_items();
        Ok(Skin {
            embed: Kernel::new(context, "skin/embed", Size::Reduce, &constants)?,
            chunk_vertices: upload(context, "chunk_vertices", &whole_texels(&model.chunk_vertices))?,
            chunk_triangles: upload(context, "chunk_triangles", &whole_texels(&model.chunk_triangles))?,
            skin_nodes: upload(context, "skin_nodes", &model.skin_nodes)?,
            skin_weights: upload(context, "skin_weights", &model.skin_weights)?,
            skin: zeros::<[f32; 4]>(context, "skin", model.skin_nodes.len())?,
            triangles: upload(context, "triangles", &model.triangles)?,
            buckets: array::<u32>(context, "buckets", bucket_words(model) as usize)?,
            hash_entries: array::<[u32; 4]>(context, "hash_entries", hash_entries)?,
            entry_hits: array::<u32>(context, "entry_hits", hash_entries)?,
            entry_cells: array::<[u32; 4]>(context, "entry_cells", hash_entries.div_ceil(2))?,
        })
    }

    /// Records the fill that empties the spatial hash and the depth grids of the vertices, in the stage pose, long
    /// before they are written.
    pub fn record_clear(&self, recorder: &mut Recorder) {
        recorder.stage("pose");
        recorder.fill(&self.buckets, shaders::NONE);
    }

    /// Records one pass, with a workgroup per active chunk.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, cull: &Cull, elastic: &Elastic) {
        recorder.stage("skin");
        let arguments = shaders::skin::Embed {
            frames: &common.frames,
            active_chunks: &cull.active_chunks,
            pairs: &cull.pairs,
            pair_proxies: &cull.pair_proxies,
            proxies: &pose.proxies,
            chunks: &cull.chunks,
            chunk_vertices: &self.chunk_vertices,
            skin_nodes: &self.skin_nodes,
            skin_weights: &self.skin_weights,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            node_info: Some(&elastic.node_info),
            contact_patches: &cull.contact_patches,
            shares: &cull.shares,
            skin: &self.skin,
            buckets: &self.buckets,
            hash_entries: &self.hash_entries,
            entry_hits: &self.entry_hits,
            entry_cells: &self.entry_cells,
            depth_grids: &cull.depth_grids,
        };
        recorder.dispatch_indirect(&self.embed, &arguments, &common.args, shaders::ARGS_ACTIVE);
    }
}

/// The probes: after each step the host computes their positions from the displacements of their nodes.
pub struct Probes {
    probe: Kernel,
    count: u32,
    nodes: Buffer,
    /// Four vec4 per probe: the displacement of each of its nodes, in the axes of the node's frame, m.
    pub displacement: Buffer,
}

impl Probes {
    /// Kernel and arrays for probes; `nodes`: the four nodes of each probe.
    pub fn new(context: &Arc<Context>, nodes: &[[u32; 4]]) -> Result<Probes> {
        Ok(Probes {
            probe: Kernel::new(context, "skin/probe", Size::Group, &[("PROBE_NODES", count(4 * nodes.len()))])?,
            count: 4 * nodes.len() as u32,
            nodes: upload(context, "probe_nodes", nodes)?,
            displacement: Buffer::new(context, "probes", (64 * nodes.len()) as u64, Memory::Readback)?,
        })
    }

    /// Records one pass over the nodes of the probes.
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
