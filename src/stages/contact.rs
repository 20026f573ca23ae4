//! Contact: depths of skin vertices, the colliding ones as a dense list, their response, and the index from nodes to them.

use std::sync::Arc;

use super::cull::Cull;
use super::depth::Depth;
use super::elastic::Elastic;
use super::model::Model;
use super::skin::Skin;
use super::types::{CHUNK_VERTICES, NONE};
use super::{Common, args, array, count, types, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};

/// Contacts a step at most; more raise the contact overflow flag.
const CAPACITY: usize = 32_768;
/// Nodes a contact acts on at most: a vertex and a triangle, four nodes each corner.
const ENTRIES: usize = 16;

/// What the solver reads of contacts. See [`Touch::nothing`] for scenes where nothing can touch.
#[derive(Clone)]
pub struct Touch {
    /// A [`types::Contact`] a colliding vertex.
    pub contacts: Buffer,
    /// Four quads of nodes a contact.
    pub entry_nodes: Buffer,
    /// Their weights.
    pub entry_weights: Buffer,
    /// First and number of each node's entries.
    pub node_entries: Buffer,
    /// Contact and weight of each entry, by node.
    pub sorted: Buffer,
    /// What each contact does to a change of velocity; see solve/apply.
    pub contact_forces: Buffer,
}

impl Touch {
    /// Where nothing can touch: two placeholders of one element, for what kernels declare but never reach.
    pub fn nothing(context: &Arc<Context>) -> Result<Touch> {
        let read = zeros::<[f32; 4]>(context, "no contact, read", 1)?;
        let written = || zeros::<[f32; 4]>(context, "no contact, written", 1);
        Ok(Touch {
            contacts: written()?,
            entry_nodes: read.clone(),
            entry_weights: read.clone(),
            node_entries: read.clone(),
            sorted: read,
            contact_forces: written()?,
        })
    }
}

/// Kernels and arrays of the stage.
pub struct Contact {
    candidates: Kernel,
    deepest: Kernel,
    response: Kernel,
    has_nodes: bool,
    sort: Kernel,
    /// What the solver reads.
    pub touch: Touch,
    fan_first: Buffer,
    fans: Buffer,
    areas: Buffer,
    candidate_hits: Buffer,
    candidate_what: Buffer,
    candidate_normals: Buffer,
    chunk_contacts: Buffer,
    /// Depth x area x outward normal of each, and its pair of proxies.
    pub candidate_pushes: Buffer,
    /// Candidate of each contact.
    pub source: Buffer,
    node_list_counts: Buffer,
    node_lists: Buffer,
    next_entries: Buffer,
    touched_nodes: Buffer,
}

impl Contact {
    /// Kernels and arrays for a model. `blend`: where two regions see a vertex alike it gets the mean of both, so that nothing
    /// jumps; otherwise the stronger one's, so that every depth is that of a ray along its normal.
    pub fn new(context: &Arc<Context>, model: &Model, blend: bool) -> Result<Contact> {
        let nodes = model.node_rest.len();
        let candidates = CHUNK_VERTICES * model.most_gathering();
        let capacity = CAPACITY.min(candidates);
        let candidate =
            [("BLEND", blend.into()), ("CAPACITY", count(capacity)), ("GROUP", context.group_size().into())];
        let lists = context.reduce_size();
        let response = [
            ("FRICTION", (model.friction[0] > 0.0).into()),
            ("LISTS", lists.into()),
            ("TOOL", model.tool_frame.is_some().into()),
        ];
        Ok(Contact {
            candidates: Kernel::new(context, "contact/candidates", Size::Reduce, &candidate)?,
            deepest: Kernel::new(context, "contact/deepest", Size::Group, &[("CAPACITY", count(capacity))])?,
            response: Kernel::new(context, "contact/response", Size::Group, &response)?,
            has_nodes: nodes > 0,
            sort: Kernel::new(context, "contact/sort", Size::Reduce, &[])?,
            touch: Touch {
                contacts: zeros::<types::Contact>(context, "contacts", capacity)?,
                entry_nodes: zeros::<[u32; 4]>(context, "nodes of contacts", 4 * capacity)?,
                entry_weights: zeros::<[f32; 4]>(context, "weights of contacts", 4 * capacity)?,
                node_entries: zeros::<[u32; 2]>(context, "contacts of nodes", nodes)?,
                sorted: zeros::<[u32; 2]>(context, "sorted entries", ENTRIES * capacity)?,
                contact_forces: zeros::<[f32; 4]>(context, "contact forces", capacity)?,
            },
            fan_first: upload(context, "first triangles around vertices", &model.fan_first)?,
            fans: upload(context, "triangles around vertices", &model.fans)?,
            areas: upload(context, "skin areas", &model.skin_areas)?,
            candidate_hits: zeros::<[f32; 4]>(context, "candidate hits", candidates)?,
            candidate_what: zeros::<[u32; 4]>(context, "candidates", candidates)?,
            candidate_normals: zeros::<[f32; 4]>(context, "normals of candidates", candidates)?,
            candidate_pushes: zeros::<[f32; 4]>(context, "pushes of candidates", candidates)?,
            chunk_contacts: array::<[u32; 2]>(context, "contacts of chunks", candidates / CHUNK_VERTICES)?,
            source: array::<u32>(context, "sources of contacts", capacity)?,
            node_list_counts: zeros::<u32>(context, "lists in use", nodes)?,
            node_lists: upload(context, "lists of nodes", &vec![NONE; nodes.max(1) * lists as usize])?,
            next_entries: array::<u32>(context, "next entries", ENTRIES * capacity)?,
            touched_nodes: array::<u32>(context, "touched nodes", nodes)?,
        })
    }

    /// What a step leaves for the next: which way its contacts pushed, for culling; and those, for who asks of the last step.
    pub fn state(&self) -> [&Buffer; 3] {
        [&self.source, &self.candidate_pushes, &self.touch.contacts]
    }

    /// Three passes over no more than there is, a fill, and a pass of no workgroup unless contacts do not fit. Without a depth
    /// stage only half-spaces are met.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        cull: &Cull,
        skin: &Skin,
        depth: Option<&Depth>,
        elastic: &Elastic,
    ) {
        recorder.stage("contact");
        let touch = &self.touch;
        if self.has_nodes {
            // Long before it is read; only touched nodes' are written.
            recorder.fill(&touch.node_entries, 0);
        }
        recorder.dispatch_indirect(
            &self.candidates,
            &[
                &common.params,
                &common.counts,
                &cull.active_chunks,
                &cull.chunks,
                &skin.chunk_vertices,
                &cull.pairs,
                &cull.regions,
                &cull.shares,
                &skin.triangles,
                &skin.skin,
                &self.fan_first,
                &self.fans,
                &self.areas,
                &skin.bin_hits,
                depth.map_or(&skin.bins, |depth| &depth.hits),
                &self.candidate_hits,
                &self.candidate_what,
                &self.candidate_normals,
                &self.candidate_pushes,
                &cull.items,
                &self.source,
                &common.args,
                &self.chunk_contacts,
            ],
            &[],
            &common.args,
            args::GATHERING,
        );
        let buffers = [&self.candidate_hits, &common.counts, &self.source, &self.chunk_contacts];
        recorder.dispatch_indirect(&self.deepest, &buffers, &[], &common.args, args::DEEPEST);
        recorder.dispatch_indirect(
            &self.response,
            &[
                &common.params,
                &common.counts,
                &cull.pairs,
                &self.candidate_normals,
                &self.source,
                &self.candidate_hits,
                &self.candidate_what,
                &skin.triangles,
                &skin.skin_nodes,
                &skin.skin_weights,
                &skin.skin,
                &elastic.velocity,
                &common.frames,
                &touch.contacts,
                &touch.entry_nodes,
                &touch.entry_weights,
                &self.node_list_counts,
                &self.node_lists,
                &self.next_entries,
                &self.touched_nodes,
                &common.args,
            ],
            &[],
            &common.args,
            args::CONTACTS,
        );
        if !self.has_nodes {
            return;
        }
        let buffers = [
            &self.touched_nodes,
            &self.node_list_counts,
            &self.node_lists,
            &self.next_entries,
            &touch.entry_weights,
            &common.counts,
            &touch.node_entries,
            &touch.sorted,
        ];
        recorder.dispatch_indirect(&self.sort, &buffers, &[], &common.args, args::NODES);
    }
}
