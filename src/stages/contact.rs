//! Contact stage, the last stage of collision detection at the start of a step: decides which skin vertices collide and
//! how deep, lists them densely as contacts, computes for each contact what the solver needs, and lists for each node
//! the contacts that act on it. A skin is the surface mesh of a body; a chunk is a group of at most 64 skin vertices,
//! active if it may meet the other body. A contact patch (`ContactPatch`) is an area with one normal where a pair of
//! bodies may touch. A vertex gathers contacts if it is tested for contact, by a ray from the vertex along the patch's
//! normal.

use std::sync::Arc;

use super::cull::Cull;
use super::depth::Depth;
use super::elastic::Elastic;
use super::model::Model;
use super::overlaps::Overlaps;
use super::skin::Skin;
use super::solve::Solve;
use super::{Common, array, count, upload, whole_texels, zeros};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};
use crate::shaders;
use crate::shaders::NONE;

/// Largest number of contacts per step; with more, the flag `CONTACT_OVERFLOW` is raised and only the deepest contacts
/// are kept.
const CAPACITY: usize = 32_768;
/// Largest number of nodes that a contact acts on: four for the skin vertex, and four for each of the three corners of
/// the triangle that its ray hits.
const ENTRIES: usize = 16;

/// The contact arrays that the solver reads. An entry is one node of a contact, with its weight.
#[derive(Clone)]
pub struct Touch {
    /// One [`shaders::Contact`] per colliding vertex.
    pub contacts: Buffer,
    /// Four uvec4 per contact: the indices of the nodes on which it acts.
    pub entry_nodes: Buffer,
    /// Four vec4 per contact: the weights of the nodes in `entry_nodes`. The sum of the nodes' velocities times these
    /// weights is the contact's relative velocity.
    pub entry_weights: Buffer,
    /// Per node: index of its first entry in `sorted`, and number of its entries.
    pub node_entries: Buffer,
    /// The entries, node by node: index of the contact, and weight as the bits of an f32.
    pub sorted: Buffer,
    /// Per contact: its part of the matrix of the solver's linear system times a change of velocity, N s; w is the
    /// component along the normal (see solve/contact_product).
    pub contact_forces: Buffer,
}

/// What contacts learn the bodies' motion from.
#[derive(Clone, Copy)]
pub struct Motion<'a> {
    /// Has the velocities of the nodes.
    pub elastic: &'a Elastic,
    /// Has the changes of velocity in the last step, from which friction predicts those of this step; `None`: nothing is
    /// solved.
    pub solve: Option<&'a Solve>,
}

/// Kernels and arrays of the contact stage.
pub struct Contact {
    candidates: Kernel,
    deepest: Kernel,
    response: Kernel,
    has_nodes: bool,
    sort: Kernel,
    /// The arrays that the solver reads.
    pub touch: Touch,
    fan_first: Buffer,
    fans: Buffer,
    areas: Buffer,
    candidate_hits: Buffer,
    candidate_what: Buffer,
    candidate_normals: Buffer,
    chunk_contacts: Buffer,
    /// Per candidate (a gathering vertex or triangle of an active chunk): the product depth x area x skin normal (m^3, oriented
    /// from body a of the pair to body b) as the bits of three f32, and the index of the pair of collision proxies
    /// (convex hulls over parts of the two skins) that touch there.
    pub candidate_pushes: Buffer,
    /// Per contact: the index of its candidate.
    pub source: Buffer,
    node_list_counts: Buffer,
    node_lists: Buffer,
    next_entries: Buffer,
    touched_nodes: Buffer,
}

impl Contact {
    /// Kernels and arrays for a model. `skins`: whether skins may meet skins; otherwise they meet half-spaces only.
    /// `blend`: whether a vertex that lies in several contact patches gets a mean of the depths and normals of the
    /// strongest patch and of every patch more than half as strong (a patch's strength is its weight at the vertex over
    /// the square of the depth), so that no force jumps; otherwise the strongest patch decides alone, and every depth
    /// is exactly that of a ray along its patch's normal.
    pub fn new(context: &Arc<Context>, model: &Model, skins: bool, blend: bool) -> Result<Contact> {
        let nodes = model.node_rest.len();
        let slots = model.slots();
        let candidates = slots * model.most_gathering();
        let capacity = CAPACITY.min(candidates);
        let candidate = [
            ("BLEND", blend.into()),
            ("CAPACITY", count(capacity)),
            ("GROUP", context.group_size().into()),
            ("SKINS", skins.into()),
            ("OVERLAPS", model.needs_overlaps().into()),
            ("SLOTS", count(slots)),
        ];
        let deepest = [("CAPACITY", count(capacity)), ("SLOTS", count(slots))];
        let lists = context.reduce_size();
        let response = [
            ("FRICTION", (model.friction[0] > 0.0).into()),
            ("LISTS", lists.into()),
            ("TOOL", model.tool_frame.is_some().into()),
            ("RIGIDS", count(model.rigid_count())),
        ];
        Ok(Contact {
            candidates: Kernel::new(context, "contact/candidates", Size::Reduce, &candidate)?,
            deepest: Kernel::new(context, "contact/deepest", Size::Group, &deepest)?,
            response: Kernel::new(context, "contact/response", Size::Group, &response)?,
            has_nodes: nodes > 0,
            sort: Kernel::new(context, "contact/sort", Size::Reduce, &[])?,
            touch: Touch {
                contacts: zeros::<shaders::Contact>(context, "contacts", capacity)?,
                entry_nodes: zeros::<[u32; 4]>(context, "entry_nodes", 4 * capacity)?,
                entry_weights: zeros::<[f32; 4]>(context, "entry_weights", 4 * capacity)?,
                node_entries: zeros::<[u32; 4]>(context, "node_entries", nodes.div_ceil(2))?,
                sorted: zeros::<[u32; 4]>(context, "sorted", (ENTRIES * capacity).div_ceil(2))?,
                contact_forces: zeros::<[f32; 4]>(context, "contact_forces", capacity)?,
            },
            fan_first: upload(context, "fan_first", &whole_texels(&model.fan_first))?,
            fans: upload(context, "fans", &whole_texels(&model.fans))?,
            areas: upload(context, "areas", &model.skin_areas)?,
            candidate_hits: zeros::<[f32; 4]>(context, "candidate_hits", candidates)?,
            candidate_what: zeros::<[u32; 4]>(context, "candidate_what", candidates)?,
            candidate_normals: zeros::<[f32; 4]>(context, "candidate_normals", candidates)?,
            candidate_pushes: zeros::<[u32; 4]>(context, "candidate_pushes", candidates)?,
            chunk_contacts: array::<u32>(context, "chunk_contacts", candidates / 32)?,
            source: array::<u32>(context, "contact_source", capacity)?,
            node_list_counts: zeros::<u32>(context, "node_list_counts", nodes)?,
            node_lists: upload(context, "node_lists", &vec![NONE; nodes.max(1) * lists as usize])?,
            next_entries: array::<u32>(context, "next_entries", ENTRIES * capacity)?,
            touched_nodes: array::<u32>(context, "touched_nodes", nodes)?,
        })
    }

    /// The arrays that a step leaves for the next: `source` and `candidate_pushes`, from which culling learns in which
    /// direction contacts pushed, and the contacts, for callers that ask for those of the last step.
    pub fn state(&self) -> [&Buffer; 3] {
        [&self.source, &self.candidate_pushes, &self.touch.contacts]
    }

    /// Records one fill, three passes (over the active chunks, the contacts and the nodes), and a fourth pass that has
    /// a workgroup only where there are more contacts than room for them. Without a depth stage vertices have contacts
    /// with half-spaces only.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        cull: &Cull,
        skin: &Skin,
        (depth, overlaps): (Option<&Depth>, Option<&Overlaps>),
        motion: &Motion,
    ) {
        recorder.stage("contact");
        let solve = motion.solve;
        let touch = &self.touch;
        if self.has_nodes {
            // This array is cleared long before it is read; the pass `sort` writes only its elements for nodes with
            // contacts.
            recorder.fill(&touch.node_entries, 0);
        }
        recorder.dispatch_indirect(
            &self.candidates,
            &shaders::contact::Candidates {
                params: &common.params,
                counts: &common.counts,
                active_chunks: &cull.active_chunks,
                chunks: &cull.chunks,
                chunk_vertices: &skin.chunk_vertices,
                pairs: &cull.pairs,
                contact_patches: &cull.contact_patches,
                shares: Some(&cull.shares),
                triangles: &skin.triangles,
                skin: &skin.skin,
                fan_first: &self.fan_first,
                fans: &self.fans,
                areas: &self.areas,
                entry_hits: &skin.entry_hits,
                hits: depth.map(|depth| &depth.hits),
                candidate_hits: &self.candidate_hits,
                candidate_what: &self.candidate_what,
                candidate_normals: &self.candidate_normals,
                candidate_pushes: &self.candidate_pushes,
                work_items: &cull.work_items,
                contact_source: Some(&self.source),
                args: &common.args,
                chunk_contacts: &self.chunk_contacts,
                chunk_triangles: overlaps.map(|_| &skin.chunk_triangles),
                overlaps: overlaps.map(|overlaps| &overlaps.overlaps),
                overlap_at: overlaps.map(|overlaps| &overlaps.overlap_at),
            },
            &common.args,
            shaders::ARGS_GATHERING,
        );
        let arguments = shaders::contact::Deepest {
            candidate_hits: &self.candidate_hits,
            counts: &common.counts,
            contact_source: &self.source,
            chunk_contacts: &self.chunk_contacts,
        };
        recorder.dispatch_indirect(&self.deepest, &arguments, &common.args, shaders::ARGS_DEEPEST);
        recorder.dispatch_indirect(
            &self.response,
            &shaders::contact::Response {
                params: &common.params,
                counts: &common.counts,
                pairs: &cull.pairs,
                candidate_normals: &self.candidate_normals,
                contact_source: &self.source,
                candidate_hits: &self.candidate_hits,
                candidate_what: &self.candidate_what,
                triangles: &skin.triangles,
                skin_nodes: &skin.skin_nodes,
                skin_weights: &skin.skin_weights,
                skin: &skin.skin,
                velocity: &motion.elastic.velocity,
                solution: solve.map(|solve| &solve.solution),
                solve: solve.map(|solve| &solve.state),
                iterates: solve.map(|solve| &solve.iterates),
                frames: &common.frames,
                contacts: &touch.contacts,
                entry_nodes: &touch.entry_nodes,
                entry_weights: &touch.entry_weights,
                node_list_counts: &self.node_list_counts,
                node_lists: &self.node_lists,
                next_entries: &self.next_entries,
                touched_nodes: &self.touched_nodes,
                args: &common.args,
            },
            &common.args,
            shaders::ARGS_CONTACTS,
        );
        if !self.has_nodes {
            return;
        }
        let arguments = shaders::contact::Sort {
            touched_nodes: &self.touched_nodes,
            node_list_counts: &self.node_list_counts,
            node_lists: &self.node_lists,
            next_entries: &self.next_entries,
            entry_weights: &touch.entry_weights,
            counts: &common.counts,
            node_entries: &touch.node_entries,
            sorted: &touch.sorted,
        };
        recorder.dispatch_indirect(&self.sort, &arguments, &common.args, shaders::ARGS_NODES);
    }
}
