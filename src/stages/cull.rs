//! Cull: which proxies may touch, in which direction, and the regions and work that follow.

use std::sync::Arc;

use super::model::Model;
use super::pose::Pose;
use super::skin::Skin;
use super::types::{ActiveProxy, Pair, Region};
use super::{Common, args, array, count, depth, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};

/// Pairs of bodies and of proxies, regions, active proxies.
pub struct Cull {
    test: Kernel,
    direction: Kernel,
    regions_kernel: Kernel,
    proxy_pair_count: u32,
    /// A [`Pair`] a pair of bodies, written by the host.
    pub pairs: Buffer,
    proxy_pairs: Buffer,
    proxy_active: Buffer,
    active_pairs: Buffer,
    reach: Buffer,
    directions: Buffer,
    /// A [`Region`] a pair of bodies.
    pub regions: Buffer,
    /// Active proxies of all regions.
    pub active_list: Buffer,
}

impl Cull {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Cull> {
        let proxy_pairs = model.proxy_pairs.len();
        let constants =
            [("PAIRS", count(model.pairs.len())), ("TILE", depth::TILE.into()), ("GROUP", context.group_size().into())];
        let pairs = (model.pairs.len() * size_of::<Pair>()) as u64;
        Ok(Cull {
            test: Kernel::new(context, "cull/pairs", Size::Group, &[("PROXY_PAIRS", count(proxy_pairs))])?,
            direction: Kernel::new(context, "cull/direction", Size::Reduce, &[])?,
            regions_kernel: Kernel::new(context, "cull/regions", Size::Reduce, &constants)?,
            proxy_pair_count: proxy_pairs as u32,
            pairs: Buffer::new(context, "pairs", pairs, Memory::Upload)?,
            proxy_pairs: upload(context, "pairs of proxies", &model.proxy_pairs)?,
            proxy_active: zeros::<u32>(context, "active proxies", model.active_slots)?,
            active_pairs: array::<u32>(context, "active pairs of proxies", proxy_pairs)?,
            reach: array::<f32>(context, "reach", proxy_pairs)?,
            directions: array::<[f32; 4]>(context, "directions", proxy_pairs)?,
            regions: array::<Region>(context, "regions", model.pairs.len())?,
            active_list: array::<ActiveProxy>(context, "list of active proxies", model.active_slots)?,
        })
    }

    /// Three passes: pairs, directions, regions.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, skin: &Skin) {
        recorder.stage("cull");
        recorder.fill(&self.proxy_active, 0);
        recorder.fill(&self.directions, 0);
        recorder.dispatch(
            &self.test,
            &[
                &common.params,
                &self.pairs,
                &skin.proxies,
                &skin.bounds,
                &self.proxy_pairs,
                &pose.hull,
                &self.proxy_active,
                &self.active_pairs,
                &self.reach,
                &common.args,
            ],
            &[],
            self.proxy_pair_count,
        );
        recorder.dispatch_indirect(
            &self.direction,
            &[
                &skin.proxies,
                &skin.bounds,
                &self.proxy_pairs,
                &pose.hull,
                &pose.faces,
                &self.active_pairs,
                &self.reach,
                &self.directions,
            ],
            &[],
            &common.args,
            args::DIRECTION,
        );
        recorder.dispatch_groups(
            &self.regions_kernel,
            &[
                &common.params,
                &self.pairs,
                &skin.proxies,
                &skin.bounds,
                &pose.hull,
                &self.proxy_active,
                &self.directions,
                &self.regions,
                &self.active_list,
                &common.counts,
                &common.args,
            ],
            &[],
            1,
        );
    }
}
