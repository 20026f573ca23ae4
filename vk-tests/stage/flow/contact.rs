//! The second half of the [`Flow`] (kernels of the proximity query and the contact response, see mod.rs): from ray hits
//! to contacts, their coefficients in the solver, and the index from nodes to the contacts that act on them. A
//! candidate is a skin vertex that may be a contact; an entry is a node with its weight in a contact.

use bytemuck::Zeroable;
use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{Contact, NONE, Overlap, RigidIterate, Solve};
use palpate::internal::stages::CHUNK_TRIANGLES;

use super::{Flow, fours, some};
use crate::harness::{case, context};

impl Flow {
    pub fn candidates(&mut self) {
        self.counts.chunks_asked = 0;
        let (slots, model) = (self.model.slots(), &self.model);
        let count = slots * self.groups(shaders::ARGS_GATHERING);
        let out = case("contact/candidates")
            .size(Size::Reduce)
            .constant("CAPACITY", self.capacity as u32)
            .constant("GROUP", context().group_size())
            .constant("OVERLAPS", model.needs_overlaps())
            .constant("SLOTS", slots as u32)
            .input("params", &[self.params])
            .inout("counts", &[self.counts])
            .input("active_chunks", &some(&self.active_chunks))
            .input("chunks", &some(&model.chunks))
            .input("chunk_vertices", &fours(&model.chunk_vertices))
            .input("pairs", &self.pairs)
            .input("contact_patches", &self.contact_patches)
            .input("shares", &fours(&self.shares))
            .input("triangles", &some(&model.triangles))
            .input("skin", &some(&self.skin))
            .input("fan_first", &fours(&model.fan_first))
            .input("fans", &fours(&model.fans))
            .input("areas", &some(&model.skin_areas))
            .input("entry_hits", &some(&self.entry_hits))
            .input("hits", &some(&self.ray_hits))
            .partial("candidate_hits", &vec![[9.0f32; 4]; count])
            .partial("candidate_what", &vec![[NONE; 4]; count])
            .partial("candidate_normals", &vec![[0.0f32; 4]; count])
            .partial("candidate_pushes", &vec![[0u32; 4]; count])
            .input("work_items", &some(&self.work_items))
            .partial("contact_source", &vec![NONE; self.capacity])
            .partial("args", &self.args)
            .inout("chunk_contacts", &vec![9u32; (count / 32).max(1)])
            .input("chunk_triangles", &fours(&model.chunk_triangles))
            .input("overlaps", &some(&self.overlaps))
            .input("overlap_at", &some(&self.overlap_at))
            .groups(self.groups(shaders::ARGS_GATHERING))
            .run();
        self.source = out.get("contact_source");
        self.args = out.get("args");
        self.counts = out.get("counts")[0];
        self.hits = out.get("candidate_hits");
        // Candidates that do not collide keep values of earlier steps and are set to zero here.
        self.chunk_contacts = out.get("chunk_contacts");
        for (i, hit) in self.hits.iter_mut().enumerate() {
            if self.chunk_contacts[i / 32] >> (i % 32) & 1 == 0 {
                *hit = [0.0; 4];
            }
        }
        self.what = out.get("candidate_what");
        self.normals = out.get("candidate_normals");
        self.pushes = out.get("candidate_pushes");
    }

    /// Runs depth/overlaps, which integrates the depth over triangles.
    pub fn overlap(&mut self) {
        let (groups, model) = (self.groups(shaders::ARGS_OVERLAPS), &self.model);
        let out = case("depth/overlaps")
            .size(Size::Reduce)
            .constant("PAIR_PROXIES", model.pair_proxies.len() as u32)
            .constant("MOST_OVERLAPS", self.most_overlaps as u32)
            .inout("counts", &[self.counts])
            .input("work_items", &some(&self.work_items))
            .input("active_chunks", &some(&self.active_chunks))
            .input("chunks", &some(&model.chunks))
            .input("chunk_triangles", &fours(&model.chunk_triangles))
            .input("pairs", &self.pairs)
            .input("pair_proxies", &some(&model.pair_proxies))
            .input("pair_proxy_counts", &some(&self.pair_proxy_counts))
            .input("proxies", &some(&model.proxies))
            .input("slabs", &some(&self.slabs))
            .input("contact_patches", &self.contact_patches)
            .input("triangles", &some(&model.triangles))
            .input("skin", &some(&self.skin))
            .partial("overlaps", &vec![Overlap::default(); self.most_overlaps])
            .partial("overlap_at", &vec![NONE; (CHUNK_TRIANGLES * groups).max(1)])
            .groups(groups)
            .run();
        self.overlaps = out.get("overlaps");
        self.overlap_at = out.get("overlap_at");
        self.counts = out.get("counts")[0];
    }

    /// Runs contact/deepest, which makes the list of the deepest candidates where not all fit.
    pub fn deepest(&mut self) {
        let out = case("contact/deepest")
            .size(Size::Group)
            .constant("CAPACITY", self.capacity as u32)
            .constant("SLOTS", self.model.slots() as u32)
            .input("candidate_hits", &some(&self.hits))
            .input("counts", &[self.counts])
            .partial("contact_source", &self.source)
            .input("chunk_contacts", &some(&self.chunk_contacts))
            .groups(self.groups(shaders::ARGS_DEEPEST))
            .run();
        self.source = out.get("contact_source");
    }

    /// Makes the list of contacts from candidates whose depths a test made up.
    pub fn list_candidates(&mut self) {
        self.source = (0..self.hits.len() as u32).filter(|i| self.hits[*i as usize][0] > 0.0).collect();
        self.counts.contacts = self.source.len() as u32;
        self.args[3 * shaders::ARGS_CONTACTS as usize] = self.counts.contacts.div_ceil(context().group_size());
    }

    pub fn respond(&mut self) {
        let (contacts, model) = (self.counts.contacts as usize, &self.model);
        let out = case("contact/response")
            .constant("FRICTION", model.friction[0] > 0.0)
            .constant("LISTS", context().reduce_size())
            .input("params", &[self.params])
            .input("counts", &[self.counts])
            .input("pairs", &self.pairs)
            .input("candidate_normals", &some(&self.normals))
            .input("contact_source", &some(&self.source))
            .input("candidate_hits", &some(&self.hits))
            .input("candidate_what", &some(&self.what))
            .input("triangles", &some(&model.triangles))
            .input("skin_nodes", &some(&model.skin_nodes))
            .input("skin_weights", &some(&model.skin_weights))
            .input("skin", &some(&self.skin))
            .input("velocity", &some(&self.velocity))
            .input("solution", &some(&self.solution))
            .constant("RIGIDS", 1u32)
            .input("solve", &[Solve { current: 1, solution_dt: self.solution_dt, ..Solve::zeroed() }])
            .input(
                "iterates",
                &[RigidIterate::zeroed(), RigidIterate { x: self.tool_change, ..RigidIterate::zeroed() }],
            )
            .input("frames", &self.frames)
            .output::<Contact>("contacts", contacts)
            .partial("entry_nodes", &vec![[NONE; 4]; 4 * contacts])
            .partial("entry_weights", &vec![[0.0f32; 4]; 4 * contacts])
            .inout("node_list_counts", &self.node_list_counts)
            .inout("node_lists", &self.node_lists)
            .partial("next_entries", &vec![NONE; 16 * contacts])
            .partial("touched_nodes", &vec![NONE; self.node_list_counts.len()])
            .inout("args", &self.args)
            .groups(self.groups(shaders::ARGS_CONTACTS))
            .run();
        self.contacts = out.get("contacts");
        self.entry_nodes = out.get("entry_nodes");
        self.entry_weights = out.get("entry_weights");
        self.node_list_counts = out.get("node_list_counts");
        self.node_lists = out.get("node_lists");
        self.next_entries = out.get("next_entries");
        self.touched_nodes = out.get("touched_nodes");
        self.args = out.get("args");
    }

    /// Runs contact/sort, which makes the index from nodes to the entries of contacts.
    pub fn sort(&mut self) {
        let entries = self.next_entries.len();
        let out = case("contact/sort")
            .size(Size::Reduce)
            .input("touched_nodes", &some(&self.touched_nodes))
            .inout("node_list_counts", &self.node_list_counts)
            .inout("node_lists", &self.node_lists)
            .input("next_entries", &some(&self.next_entries))
            .input("entry_weights", &some(&self.entry_weights))
            .inout("counts", &[self.counts])
            .partial("node_entries", &self.node_entries)
            .partial("sorted", &vec![[NONE; 2]; entries])
            .groups(self.groups(shaders::ARGS_NODES))
            .run();
        self.node_list_counts = out.get("node_list_counts");
        self.node_lists = out.get("node_lists");
        self.counts = out.get("counts")[0];
        self.node_entries = out.get("node_entries");
        self.sorted = out.get("sorted");
        self.sorted.truncate(self.counts.entries as usize);
    }
}
