//! Skin: how far it may have moved (before culling), where it is (after), and the probed vertices.

use std::sync::Arc;

use super::cull::Cull;
use super::elastic::Elastic;
use super::model::Model;
use super::pose::Pose;
use super::{Common, args, array, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};

/// Topology and embedding of all skins, and their positions this step.
pub struct Skin {
    bound: Kernel,
    embed: Kernel,
    proxy_count: u32,
    /// Proxies of all bodies.
    pub proxies: Buffer,
    proxy_nodes: Buffer,
    proxy_embeds: Buffer,
    /// Bounds of each proxy this step.
    pub bounds: Buffer,
    /// Four nodes a skin vertex.
    pub skin_nodes: Buffer,
    /// Four weights, or the position on a rigid body.
    pub skin_weights: Buffer,
    /// Positions, and the step they are of.
    pub skin: Buffer,
    /// Three skin vertices a triangle.
    pub triangles: Buffer,
}

impl Skin {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Skin> {
        let spans = ("SPANS", Const::Bool(model.spans_frames()));
        Ok(Skin {
            bound: Kernel::new(context, "skin/bound", Size::Reduce, &[spans])?,
            embed: Kernel::new(context, "skin/embed", Size::Group, &[spans])?,
            proxy_count: model.proxies.len() as u32,
            proxies: upload(context, "proxies", &model.proxies)?,
            proxy_nodes: upload(context, "nodes of proxies", &model.proxy_nodes)?,
            proxy_embeds: upload(context, "skin of proxies", &model.proxy_embeds)?,
            bounds: array::<super::types::ProxyBounds>(context, "bounds", model.proxies.len())?,
            skin_nodes: upload(context, "nodes of the skin", &model.skin_nodes)?,
            skin_weights: upload(context, "weights of the skin", &model.skin_weights)?,
            skin: zeros::<[f32; 4]>(context, "skin", model.skin_nodes.len())?,
            triangles: upload(context, "triangles", &model.triangles)?,
        })
    }

    /// Before culling: a workgroup a proxy.
    pub fn record_bounds(&self, recorder: &mut Recorder, common: &Common, pose: &Pose, elastic: &Elastic) {
        recorder.stage("skin");
        let buffers = [
            &self.proxies,
            &pose.hull,
            &self.proxy_nodes,
            &elastic.displacement,
            &elastic.node_rest,
            &common.links,
            &self.bounds,
        ];
        recorder.dispatch_groups(&self.bound, &buffers, &[], self.proxy_count);
    }

    /// After culling: the skin of active proxies.
    pub fn record_embedding(&self, recorder: &mut Recorder, common: &Common, cull: &Cull, elastic: &Elastic) {
        recorder.stage("skin");
        recorder.dispatch_indirect(
            &self.embed,
            &[
                &common.params,
                &common.frames,
                &common.counts,
                &cull.active_list,
                &self.proxies,
                &self.proxy_embeds,
                &self.skin_nodes,
                &self.skin_weights,
                &elastic.node_rest,
                &elastic.displacement,
                &elastic.node_info,
                &self.skin,
            ],
            &[],
            &common.args,
            args::EMBED,
        );
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
            nodes: upload(context, "nodes of probes", nodes)?,
            displacement: Buffer::new(context, "probes", (64 * nodes.len()) as u64, Memory::Readback)?,
        })
    }

    /// One pass over the nodes of probes.
    pub fn record(&self, recorder: &mut Recorder, elastic: &Elastic) {
        recorder.stage("skin");
        recorder.dispatch(&self.probe, &[&self.nodes, &elastic.displacement, &self.displacement], &[], self.count);
    }
}
