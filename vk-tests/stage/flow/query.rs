//! The first half of the [`Flow`] (kernels of the proximity query and the contact response, see mod.rs): from bodies in
//! their rigid coordinate frames to ray hits of skin vertices.

use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, NONE, ProxyBounds};
use palpate::internal::stages::{CHUNK_VERTICES, PAIR_PATCHES};

use super::{Flow, GRID_WORDS, fours, pairs, some};
use crate::harness::case;

impl Flow {
    pub fn place(&mut self) {
        let (proxies, hulls, faces) = (self.model.proxies.len(), self.model.hull.len(), self.model.faces.len());
        let out = case("pose/place")
            .size(Size::Reduce)
            .constant("SPANS", self.model.spans_frames())
            .input("frames", &self.frames)
            .input("proxies", &some(&self.model.proxies))
            .input("hull_rest", &some(&self.model.hull))
            .input("face_rest", &some(&self.model.faces))
            .input("proxy_nodes", &pairs(&self.model.proxy_nodes))
            .input("displacement", &some(&self.displacement))
            .input("node_rest", &some(&self.model.node_rest))
            .input("links", &self.links)
            .output::<[f32; 4]>("hull", hulls)
            .output::<[f32; 4]>("faces", faces)
            .output::<ProxyBounds>("bounds", proxies)
            .inout("counts", &[self.counts])
            .partial("args", &self.args)
            .groups(proxies)
            .run();
        self.hull = out.get("hull");
        self.faces = out.get("faces");
        self.bounds = out.get("bounds");
        self.counts = out.get("counts")[0];
        self.args = out.get("args");
    }

    pub fn test_pairs(&mut self) {
        let count = self.model.proxy_pairs.len();
        let out = case("cull/pairs")
            .size(Size::Reduce)
            .constant("PROXY_PAIRS", count as u32)
            .constant("SHARE", 64u32)
            .input("proxies", &self.model.proxies)
            .input("bounds", &self.bounds)
            .input("proxy_pairs", &some(&self.model.proxy_pairs))
            .input("hull", &some(&self.hull))
            .partial("active_pairs", &vec![NONE; count])
            .partial("reach_of", &vec![[-1.0f32; 2]; count])
            .partial("directions", &vec![[0.0f32; 4]; 2 * count])
            .inout("args", &self.args)
            .groups(count.div_ceil(64))
            .run();
        self.active_pairs = out.get("active_pairs");
        self.reach = out.get("reach_of");
        self.directions = out.get("directions");
        self.args = out.get("args");
    }

    pub fn direct(&mut self) {
        let out = case("cull/direction")
            .size(Size::Reduce)
            .input("proxies", &self.model.proxies)
            .input("bounds", &self.bounds)
            .input("proxy_pairs", &some(&self.model.proxy_pairs))
            .input("hull", &some(&self.hull))
            .input("faces", &some(&self.faces))
            .input("active_pairs", &some(&self.active_pairs))
            .input("reach_of", &some(&self.reach))
            .partial("directions", &self.directions)
            .input("counts", &[self.counts])
            .input("contact_source", &some(&self.source))
            .input("candidate_pushes", &some(&self.pushes))
            .groups(self.groups(shaders::ARGS_DIRECTION))
            .run();
        self.directions = out.get("directions");
    }

    pub fn find_contact_patches(&mut self) {
        let (pairs, pair_proxies) = (self.pairs.len(), self.model.pair_proxies.len());
        let out = case("cull/contact_patches")
            .size(Size::Reduce)
            .input("params", &[self.params])
            .input("pairs", &self.pairs)
            .input("proxies", &self.model.proxies)
            .input("bounds", &self.bounds)
            .input("hull", &some(&self.hull))
            .input("directions", &some(&self.directions))
            .inout("contact_patches", &self.contact_patches)
            .partial("shares", &vec![-1.0f32; PAIR_PATCHES * pair_proxies])
            .inout("boxes", &vec![[[0.0f32; 3]; 2]; PAIR_PATCHES * pair_proxies])
            .inout("proxy_patches", &vec![NONE; pair_proxies])
            .partial("pair_proxy_counts", &vec![[0u32; 2]; pair_proxies])
            .partial("active_pair_proxies", &vec![NONE; pair_proxies])
            .partial("depth_grids", &vec![7u32; PAIR_PATCHES * pairs * GRID_WORDS])
            .inout("counts", &[self.counts])
            .inout("args", &self.args)
            .partial("near_pairs", &vec![NONE; self.model.proxy_pairs.len()])
            .groups(pairs)
            .run();
        self.contact_patches = out.get("contact_patches");
        self.shares = out.get("shares");
        self.boxes = out.get("boxes");
        self.proxy_patches = out.get("proxy_patches");
        self.pair_proxy_counts = out.get("pair_proxy_counts");
        self.active_pair_proxies = out.get("active_pair_proxies");
        self.depth_grids = out.get("depth_grids");
        self.counts = out.get("counts")[0];
        self.args = out.get("args");
    }

    pub fn box_chunks(&mut self) {
        let (model, chunks) = (&self.model, self.model.pair_proxy_chunks);
        let out = case("cull/chunks")
            .size(Size::Reduce)
            .constant("SPANS", model.spans_frames())
            .input("pairs", &self.pairs)
            .input("pair_proxies", &model.pair_proxies)
            .input("active_pair_proxies", &self.active_pair_proxies)
            .input("frames", &self.frames)
            .input("proxies", &model.proxies)
            .input("chunks", &some(&model.chunks))
            .input("chunk_nodes", &pairs(&model.chunk_nodes))
            .input("displacement", &some(&self.displacement))
            .input("node_rest", &some(&model.node_rest))
            .input("links", &self.links)
            .input("contact_patches", &self.contact_patches)
            .input("boxes", &self.boxes)
            .input("proxy_patches", &self.proxy_patches)
            .partial("pair_proxy_chunks", &vec![[NONE; 2]; chunks])
            .partial("slabs", &vec![[f32::NAN; 8]; PAIR_PATCHES * chunks])
            .inout("depth_grids", &self.depth_grids)
            .groups(self.groups(shaders::ARGS_CHUNKS))
            .run();
        self.pair_proxy_chunks = out.get("pair_proxy_chunks");
        self.slabs = out.get("slabs");
        self.depth_grids = out.get("depth_grids");
    }

    pub fn meet(&mut self) {
        let out = case("cull/meet")
            .size(Size::Reduce)
            .constant("PAIR_PROXIES", self.model.pair_proxies.len() as u32)
            .constant("MAX_WORK_ITEMS", self.max_work_items as u32)
            .constant("GATHERING", self.model.gathering_pair_proxies as u32)
            .input("pairs", &self.pairs)
            .input("pair_proxies", &self.model.pair_proxies)
            .input("active_pair_proxies", &self.active_pair_proxies)
            .input("proxies", &self.model.proxies)
            .input("contact_patches", &self.contact_patches)
            .input("slabs", &self.slabs)
            .input("depth_grids", &self.depth_grids)
            .inout("pair_proxy_chunks", &some(&self.pair_proxy_chunks))
            .inout("pair_proxy_counts", &self.pair_proxy_counts)
            .partial("active_chunks", &vec![ActiveChunk { chunk: NONE, ..Default::default() }; self.max_work_items])
            .partial("work_items", &vec![[NONE; 2]; self.max_work_items])
            .inout("counts", &[self.counts])
            .partial("args", &self.args)
            .groups(self.groups(shaders::ARGS_CHUNKS))
            .run();
        self.pair_proxy_chunks = out.get("pair_proxy_chunks");
        self.pair_proxy_counts = out.get("pair_proxy_counts");
        self.active_chunks = out.get("active_chunks");
        self.work_items = out.get("work_items");
        self.counts = out.get("counts")[0];
        self.args = out.get("args");
    }

    /// Number of words of `buckets`, rounded up to whole texels of four. `buckets` holds the heads of the spatial
    /// hash's lists and, for each side and grid cell of each contact patch, the sort key of the vertex that
    /// lies farthest into the other body.
    fn bucket_words(&self) -> usize {
        (self.bucket_count as usize + PAIR_PATCHES * self.pairs.len() * GRID_WORDS).next_multiple_of(4)
    }

    pub fn embed(&mut self) {
        let (model, hash_entries) = (&self.model, CHUNK_VERTICES * self.max_work_items);
        let out = case("skin/embed")
            .size(Size::Reduce)
            .constant("BUCKETS", self.bucket_count)
            .constant("SPANS", model.spans_frames())
            .input("frames", &self.frames)
            .input("active_chunks", &some(&self.active_chunks))
            .input("pairs", &self.pairs)
            .input("pair_proxies", &model.pair_proxies)
            .input("proxies", &model.proxies)
            .input("chunks", &some(&model.chunks))
            .input("chunk_vertices", &fours(&model.chunk_vertices))
            .input("skin_nodes", &some(&model.skin_nodes))
            .input("skin_weights", &some(&model.skin_weights))
            .input("node_rest", &some(&model.node_rest))
            .input("displacement", &some(&self.displacement))
            .input("node_info", &some(&model.node_info))
            .input("contact_patches", &self.contact_patches)
            .input("shares", &fours(&self.shares))
            .partial("skin", &self.skin)
            .inout("buckets", &vec![NONE; self.bucket_words()])
            .partial("hash_entries", &vec![[NONE - 1; 4]; hash_entries])
            .partial("entry_hits", &vec![NONE - 1; hash_entries])
            .partial("entry_cells", &vec![[NONE - 1; 2]; hash_entries])
            .input("depth_grids", &self.depth_grids)
            .groups(self.groups(shaders::ARGS_ACTIVE))
            .run();
        self.skin = out.get("skin");
        self.buckets = out.get("buckets");
        self.hash_entries = out.get("hash_entries");
        self.entry_hits = out.get("entry_hits");
        self.entry_cells = out.get("entry_cells");
    }

    /// Runs depth/ray_hits, the compute implementation of the depth stage.
    pub fn cross(&mut self) {
        let model = &self.model;
        let out = case("depth/ray_hits")
            .size(Size::Reduce)
            .constant("BUCKETS", self.bucket_count)
            .constant("MOST_HITS", self.most_hits as u32)
            .inout("counts", &[self.counts])
            .input("work_items", &some(&self.work_items))
            .input("active_chunks", &some(&self.active_chunks))
            .input("chunks", &some(&model.chunks))
            .input("chunk_triangles", &fours(&model.chunk_triangles))
            .input("contact_patches", &self.contact_patches)
            .input("triangles", &some(&model.triangles))
            .input("skin", &some(&self.skin))
            .input("buckets", &self.buckets)
            .input("hash_entries", &some(&self.hash_entries))
            .input("entry_cells", &some(&self.entry_cells))
            .inout("entry_hits", &self.entry_hits)
            .partial("hits", &vec![[NONE; 4]; self.most_hits])
            .input("pairs", &self.pairs)
            .groups(self.groups(shaders::ARGS_WORK_ITEMS))
            .run();
        self.counts = out.get("counts")[0];
        self.entry_hits = out.get("entry_hits");
        self.ray_hits = out.get("hits");
    }
}
