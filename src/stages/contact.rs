//! Contact: depths of skin vertices, the colliding ones as a dense list, their response, and the index from nodes to them.

use std::sync::Arc;

use super::cull::Cull;
use super::depth::Depth;
use super::elastic::Elastic;
use super::model::Model;
use super::skin::Skin;
use super::{Common, args, array, count, types, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};

/// Contacts a step at most; more raise the contact overflow flag.
const CAPACITY: usize = 16_384;
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
    compact: Kernel,
    response: Kernel,
    place: Kernel,
    fill: Kernel,
    sort: Kernel,
    /// What the solver reads.
    pub touch: Touch,
    proxy_vertices: Buffer,
    neighbours: Buffer,
    fan_first: Buffer,
    fans: Buffer,
    areas: Buffer,
    candidate_hits: Buffer,
    candidate_what: Buffer,
    source: Buffer,
    node_count: Buffer,
    cursor: Buffer,
    unsorted: Buffer,
}

impl Contact {
    /// Kernels and arrays for a model; `tile`: see [`super::depth::tile_of`].
    pub fn new(context: &Arc<Context>, model: &Model, tile: u32) -> Result<Contact> {
        let (nodes, capacity) = (model.node_rest.len(), CAPACITY.min(model.candidates));
        let compact = [
            ("CAPACITY", count(capacity)),
            ("NODES", count(nodes)),
            ("TETRAHEDRA", count(model.tetrahedra.len())),
            ("GROUP", context.group_size().into()),
        ];
        let [friction, speed] = model.friction;
        let response = [("FRICTION_COEFFICIENT", friction.into()), ("FRICTION_SPEED", speed.into())];
        let group = |name: &str| Kernel::new(context, name, Size::Group, &[]);
        Ok(Contact {
            candidates: Kernel::new(context, "contact/candidates", Size::Group, &[("TILE", tile.into())])?,
            compact: Kernel::new(context, "contact/compact", Size::Reduce, &compact)?,
            response: Kernel::new(context, "contact/response", Size::Group, &response)?,
            place: Kernel::new(context, "contact/place", Size::Group, &[("NODES", count(nodes))])?,
            fill: group("contact/fill")?,
            sort: group("contact/sort")?,
            touch: Touch {
                contacts: zeros::<types::Contact>(context, "contacts", capacity)?,
                entry_nodes: zeros::<[u32; 4]>(context, "nodes of contacts", 4 * capacity)?,
                entry_weights: zeros::<[f32; 4]>(context, "weights of contacts", 4 * capacity)?,
                node_entries: zeros::<[u32; 2]>(context, "contacts of nodes", nodes)?,
                sorted: zeros::<[u32; 2]>(context, "sorted entries", ENTRIES * capacity)?,
                contact_forces: zeros::<[f32; 4]>(context, "contact forces", capacity)?,
            },
            proxy_vertices: upload(context, "vertices of proxies", &model.proxy_vertices)?,
            neighbours: upload(context, "neighbours", &model.neighbours)?,
            fan_first: upload(context, "first triangles around vertices", &model.fan_first)?,
            fans: upload(context, "triangles around vertices", &model.fans)?,
            areas: upload(context, "skin areas", &model.skin_areas)?,
            candidate_hits: zeros::<[f32; 4]>(context, "candidate hits", model.candidates)?,
            candidate_what: zeros::<[u32; 4]>(context, "candidates", model.candidates)?,
            source: array::<u32>(context, "sources of contacts", capacity)?,
            node_count: zeros::<u32>(context, "entries of nodes", nodes)?,
            cursor: array::<u32>(context, "cursors", nodes)?,
            unsorted: array::<u32>(context, "unsorted entries", ENTRIES * capacity)?,
        })
    }

    /// Six passes, each over no more than there is. Without a depth field only half-spaces are met.
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
        recorder.fill(&self.node_count, 0);
        recorder.fill(&touch.node_entries, 0);
        recorder.dispatch_indirect(
            &self.candidates,
            &[
                &common.params,
                &common.counts,
                &cull.active_list,
                &skin.proxies,
                &self.proxy_vertices,
                &cull.pairs,
                &cull.regions,
                depth.map_or(&self.proxy_vertices, |depth| &depth.names),
                &skin.triangles,
                &self.neighbours,
                &skin.skin,
                &self.fan_first,
                &self.fans,
                &self.areas,
                &self.candidate_hits,
                &self.candidate_what,
            ],
            &[],
            &common.args,
            args::CANDIDATES,
        );
        let buffers = [&self.candidate_hits, &common.counts, &self.source, &common.args];
        recorder.dispatch_indirect(&self.compact, &buffers, &[], &common.args, args::COMPACT);
        recorder.dispatch_indirect(
            &self.response,
            &[
                &common.params,
                &common.counts,
                &cull.pairs,
                &cull.regions,
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
                &self.node_count,
            ],
            &[],
            &common.args,
            args::CONTACTS,
        );
        let buffers = [&self.node_count, &common.counts, &touch.node_entries, &self.cursor];
        recorder.dispatch_indirect(&self.place, &buffers, &[], &common.args, args::CONTACT_NODES);
        let entries = [&common.counts, &touch.contacts, &touch.entry_nodes, &touch.entry_weights];
        let mut buffers = entries.to_vec();
        buffers.extend([&self.cursor, &self.unsorted]);
        recorder.dispatch_indirect(&self.fill, &buffers, &[], &common.args, args::ENTRIES);
        let mut buffers = entries.to_vec();
        buffers.extend([&touch.node_entries, &self.unsorted, &touch.sorted]);
        recorder.dispatch_indirect(&self.sort, &buffers, &[], &common.args, args::ENTRIES);
    }
}
