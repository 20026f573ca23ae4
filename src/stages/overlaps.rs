//! Part of the depth stage (narrow phase), for pairs of bodies whose triangles are tested for contact in place of
//! vertices: how far each triangle of the gathering skin (surface mesh) overlaps the other body's skin along the normal
//! of a contact patch. A contact patch is an area with one normal where two bodies may touch. A chunk is a group of at
//! most 128 triangles, active if it may meet the other body.

use std::sync::Arc;

use super::cull::Cull;
use super::model::Model;
use super::pose::Pose;
use super::skin::Skin;
use super::{CHUNK_TRIANGLES, Common, array, count, depth};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};
use crate::shaders::{self, Overlap};

/// Greatest number of overlaps in a step; with more, the flag `CONTACT_OVERFLOW` is raised and some are left out.
const MOST_OVERLAPS: usize = 1 << 16;

/// Kernel and arrays of the overlaps.
pub struct Overlaps {
    integrate: Kernel,
    /// The overlaps, in any order.
    pub overlaps: Buffer,
    /// Per work item (an active chunk of a gathering skin in one contact patch) and triangle: index of its overlap, or
    /// `NONE`.
    pub overlap_at: Buffer,
}

impl Overlaps {
    /// Kernel and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Overlaps> {
        let triangles = CHUNK_TRIANGLES * model.max_gathering_work_items();
        let most = triangles.min(MOST_OVERLAPS);
        let constants = [("PAIR_PROXIES", count(model.pair_proxies.len())), ("MOST_OVERLAPS", count(most))];
        Ok(Overlaps {
            integrate: Kernel::new(context, "depth/overlaps", Size::Reduce, &constants)?,
            overlaps: array::<Overlap>(context, "overlaps", most)?,
            overlap_at: array::<u32>(context, "overlap_at", triangles)?,
        })
    }

    /// Records one pass, with a workgroup for each work item whose skin is tested for contact.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, cull: &Cull, skin: &Skin) {
        recorder.stage(depth::STAGE);
        let arguments = shaders::depth::Overlaps {
            counts: &common.counts,
            work_items: &cull.work_items,
            active_chunks: &cull.active_chunks,
            chunks: &cull.chunks,
            chunk_triangles: &skin.chunk_triangles,
            pairs: &cull.pairs,
            pair_proxies: &cull.pair_proxies,
            pair_proxy_counts: &cull.pair_proxy_counts,
            proxies: &pose.proxies,
            slabs: &cull.slabs,
            contact_patches: &cull.contact_patches,
            triangles: &skin.triangles,
            skin: &skin.skin,
            overlaps: &self.overlaps,
            overlap_at: &self.overlap_at,
        };
        recorder.dispatch_indirect(&self.integrate, &arguments, &common.args, shaders::ARGS_OVERLAPS);
    }
}
