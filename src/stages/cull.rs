//! Cull stage (broad phase), after the pose stage of a step: finds which collision proxies (convex hulls that cover the
//! skin, a body's surface mesh) of two bodies may touch and in which directions, groups the directions into contact
//! patches (`ContactPatch`: areas with one normal each), and lists the active chunks. A chunk is a group of at most 64
//! skin vertices with their triangles, active if it may meet the other body; a work item is an active chunk in one
//! contact patch.

use std::sync::Arc;

use super::contact::Contact;
use super::elastic::Elastic;
use super::model::Model;
use super::pose::Pose;
use super::{Common, array, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::{ActiveChunk, ContactPatch, Pair};
use crate::stages::PAIR_PATCHES;

/// Length in words of a contact patch's min-max depth grid, which has GRID x GRID cells for each of the two bodies; a
/// cell holds how far that body reaches along the patch's normal.
pub(super) const GRID_WORDS: usize = 2 * (shaders::GRID * shaders::GRID) as usize;

/// Largest number of cells of the spatial hash (a table of skin vertices by cell of a contact patch's plane) along a
/// side of the rectangle that the patch covers. A point on the rectangle's far edge may lie in one further cell.
pub const MOST_CELLS: u32 = 128;

/// Kernels and arrays of the cull stage: pairs of bodies and of proxies, contact patches, active chunks.
pub struct Cull {
    test: Kernel,
    direction: Kernel,
    contact_patches_kernel: Kernel,
    chunks_kernel: Kernel,
    meet: Kernel,
    pair_count: u32,
    test_groups: u32,
    /// One [`Pair`] per pair of bodies, written by the host.
    pub pairs: Buffer,
    proxy_pairs: Buffer,
    active_pairs: Buffer,
    reach: Buffer,
    near_pairs: Buffer,
    directions: Buffer,
    /// [`PAIR_PATCHES`] contact patches per pair of bodies, one [`ContactPatch`] each.
    pub contact_patches: Buffer,
    /// One [`crate::shaders::PairProxy`] per pair proxy, which is one collision proxy in one pair of bodies.
    pub pair_proxies: Buffer,
    /// Per pair proxy: the weight, from 0 to 1, that each contact patch of its pair of bodies has at the proxy's
    /// vertices.
    pub shares: Buffer,
    boxes: Buffer,
    proxy_patches: Buffer,
    /// Per pair proxy: the numbers of active chunks and of work items before its own.
    pub pair_proxy_counts: Buffer,
    active_pair_proxies: Buffer,
    /// The chunks of all collision proxies, one [`crate::shaders::Chunk`] each.
    pub chunks: Buffer,
    /// The nodes whose displacements move each chunk, chunk by chunk.
    pub chunk_nodes: Buffer,
    pair_proxy_chunks: Buffer,
    /// Bounds of the chunks, [`PAIR_PATCHES`] per chunk of a pair proxy.
    pub slabs: Buffer,
    /// The min-max depth grids of all contact patches: how far the chunks of either body reach along the patch's normal
    /// in each cell.
    pub depth_grids: Buffer,
    /// The chunks that may meet the other body, one [`ActiveChunk`] each.
    pub active_chunks: Buffer,
    /// One per work item: index of its active chunk, and index of its contact patch.
    pub work_items: Buffer,
}

impl Cull {
    /// Kernels and arrays for a model. `smooth`: whether the normals of contact patches turn only a quarter of the way
    /// towards their new direction in a step; otherwise they turn all the way.
    pub fn new(context: &Arc<Context>, model: &Model, smooth: bool) -> Result<Cull> {
        let (proxy_pairs, pair_proxies, work_items) =
            (model.proxy_pairs.len(), model.pair_proxies.len(), model.max_work_items());
        let follow: f32 = if smooth { 0.25 } else { 1.0 };
        let spans = ("SPANS", Const::Bool(model.spans_frames()));
        let list = [
            ("PAIR_PROXIES", count(pair_proxies)),
            ("MAX_WORK_ITEMS", count(work_items)),
            ("GATHERING", count(model.gathering_pair_proxies)),
        ];
        // A workgroup tests 128 pairs of proxies, but at least one and at most eight per lane. Only pairs whose boxes
        // meet need further work; the more pairs a workgroup tests, the better those pairs fill its lanes.
        let lanes = context.reduce_size();
        let share = (8 * lanes).min(lanes.max(128));
        let reduce = |name: &str, constants: &[(&str, Const)]| Kernel::new(context, name, Size::Reduce, constants);
        let pairs = (model.pairs.len() * size_of::<Pair>()) as u64;
        Ok(Cull {
            test: reduce("cull/pairs", &[("PROXY_PAIRS", count(proxy_pairs)), ("SHARE", share.into())])?,
            test_groups: (proxy_pairs as u32).div_ceil(share),
            direction: reduce("cull/direction", &[])?,
            contact_patches_kernel: reduce(
                "cull/contact_patches",
                &[("MOST_CELLS", MOST_CELLS.into()), ("FOLLOW", follow.into())],
            )?,
            chunks_kernel: reduce("cull/chunks", &[spans])?,
            meet: reduce("cull/meet", &list)?,
            pair_count: model.pairs.len() as u32,
            pairs: Buffer::new(context, "pairs", pairs, Memory::Upload)?,
            proxy_pairs: upload(context, "proxy_pairs", &model.proxy_pairs)?,
            active_pairs: array::<u32>(context, "active_pairs", proxy_pairs)?,
            reach: array::<[f32; 2]>(context, "reach_of", proxy_pairs)?,
            near_pairs: array::<u32>(context, "near_pairs", proxy_pairs)?,
            directions: zeros::<[f32; 4]>(context, "directions", 2 * proxy_pairs)?,
            contact_patches: zeros::<ContactPatch>(context, "contact_patches", PAIR_PATCHES * model.pairs.len())?,
            pair_proxies: upload(context, "pair_proxies", &model.pair_proxies)?,
            shares: array::<f32>(context, "shares", PAIR_PATCHES * pair_proxies)?,
            boxes: array::<[f32; 6]>(context, "boxes", PAIR_PATCHES * pair_proxies)?,
            proxy_patches: array::<u32>(context, "proxy_patches", pair_proxies)?,
            pair_proxy_counts: zeros::<[u32; 2]>(context, "pair_proxy_counts", pair_proxies)?,
            active_pair_proxies: array::<u32>(context, "active_pair_proxies", pair_proxies)?,
            chunks: upload(context, "chunks", &model.chunks)?,
            chunk_nodes: upload(context, "chunk_nodes", &model.chunk_nodes)?,
            pair_proxy_chunks: array::<[u32; 2]>(context, "pair_proxy_chunks", model.pair_proxy_chunks)?,
            slabs: array::<[f32; 8]>(context, "slabs", PAIR_PATCHES * model.pair_proxy_chunks)?,
            depth_grids: array::<u32>(context, "depth_grids", PAIR_PATCHES * model.pairs.len() * GRID_WORDS)?,
            active_chunks: array::<ActiveChunk>(context, "active_chunks", work_items)?,
            work_items: array::<[u32; 2]>(context, "work_items", work_items)?,
        })
    }

    /// The array that a step leaves for the next: the contact patches, since their normals turn gradually.
    pub fn state(&self) -> [&Buffer; 1] {
        [&self.contact_patches]
    }

    /// Records up to five passes, which make: the list of pairs of proxies that may touch, the contact directions of
    /// these pairs, the contact patches, the bounds of chunks, and the list of chunks that meet. `last`: the contact
    /// stage, which still holds the contacts of the last step.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, last: &Contact, elastic: &Elastic) {
        recorder.stage("cull");
        if self.test_groups > 0 {
            self.record_directions(recorder, common, pose, last);
        }
        let arguments = shaders::cull::ContactPatches {
            params: &common.params,
            pairs: &self.pairs,
            proxies: &pose.proxies,
            bounds: &pose.bounds,
            hull: &pose.hull,
            directions: &self.directions,
            contact_patches: &self.contact_patches,
            shares: &self.shares,
            boxes: &self.boxes,
            proxy_patches: &self.proxy_patches,
            pair_proxy_counts: &self.pair_proxy_counts,
            active_pair_proxies: &self.active_pair_proxies,
            depth_grids: &self.depth_grids,
            counts: &common.counts,
            args: &common.args,
            near_pairs: &self.near_pairs,
        };
        recorder.dispatch_groups(&self.contact_patches_kernel, &arguments, self.pair_count);
        let arguments = shaders::cull::Chunks {
            pairs: &self.pairs,
            pair_proxies: &self.pair_proxies,
            active_pair_proxies: &self.active_pair_proxies,
            frames: &common.frames,
            proxies: &pose.proxies,
            chunks: &self.chunks,
            chunk_nodes: &self.chunk_nodes,
            displacement: &elastic.displacement,
            node_rest: Some(&elastic.node_rest),
            links: Some(&common.links),
            contact_patches: &self.contact_patches,
            boxes: &self.boxes,
            proxy_patches: &self.proxy_patches,
            pair_proxy_chunks: &self.pair_proxy_chunks,
            slabs: &self.slabs,
            depth_grids: &self.depth_grids,
        };
        recorder.dispatch_indirect(&self.chunks_kernel, &arguments, &common.args, shaders::ARGS_CHUNKS);
        let arguments = shaders::cull::Meet {
            pairs: &self.pairs,
            pair_proxies: &self.pair_proxies,
            active_pair_proxies: &self.active_pair_proxies,
            proxies: &pose.proxies,
            contact_patches: &self.contact_patches,
            slabs: &self.slabs,
            depth_grids: &self.depth_grids,
            pair_proxy_chunks: &self.pair_proxy_chunks,
            pair_proxy_counts: &self.pair_proxy_counts,
            active_chunks: &self.active_chunks,
            work_items: &self.work_items,
            counts: &common.counts,
            args: &common.args,
        };
        recorder.dispatch_indirect(&self.meet, &arguments, &common.args, shaders::ARGS_CHUNKS);
    }

    fn record_directions(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, last: &Contact) {
        let arguments = shaders::cull::Pairs {
            proxies: &pose.proxies,
            bounds: &pose.bounds,
            proxy_pairs: &self.proxy_pairs,
            hull: &pose.hull,
            active_pairs: &self.active_pairs,
            reach_of: &self.reach,
            directions: &self.directions,
            args: &common.args,
        };
        recorder.dispatch_groups(&self.test, &arguments, self.test_groups);
        let arguments = shaders::cull::Direction {
            proxies: &pose.proxies,
            bounds: &pose.bounds,
            proxy_pairs: &self.proxy_pairs,
            hull: &pose.hull,
            faces: &pose.faces,
            active_pairs: &self.active_pairs,
            reach_of: &self.reach,
            directions: &self.directions,
            counts: &common.counts,
            contact_source: &last.source,
            candidate_pushes: &last.candidate_pushes,
        };
        recorder.dispatch_indirect(&self.direction, &arguments, &common.args, shaders::ARGS_DIRECTION);
    }
}
