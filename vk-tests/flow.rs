//! The kernels from pose to contact, one case of the harness each, every one fed with what the one before it wrote; so
//! that a law can be put to the whole query while each kernel is still guarded by itself.

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};
use palpate::gpu::{Buffer, DepthTest, Memory, Pass, RasterPipeline, RasterTarget, Recorder, Size};
use palpate::prepare::Body;
use palpate::scene::{self, Scene};
use palpate::stages::args;
use palpate::stages::depth::Path;
use palpate::stages::model::{Model, texel};
use palpate::stages::types::{ActiveProxy, Contact, Counts, Frame, Link, NONE, Pair, ProxyBounds, Region, StepParams};

use crate::harness::{assert_clean, case, context};

/// Inputs and outputs of the kernels, as the host would read them.
pub struct Flow {
    pub model: Model,
    pub params: StepParams,
    pub frames: Vec<Frame>,
    pub pairs: Vec<Pair>,
    pub displacement: Vec<[f32; 4]>,
    pub velocity: Vec<[f32; 4]>,
    pub tile: u32,
    pub capacity: usize,
    pub hull: Vec<[f32; 4]>,
    pub faces: Vec<[f32; 4]>,
    pub bounds: Vec<ProxyBounds>,
    pub proxy_active: Vec<u32>,
    pub active_pairs: Vec<u32>,
    pub reach: Vec<f32>,
    pub directions: Vec<[f32; 4]>,
    pub regions: Vec<Region>,
    pub active_list: Vec<ActiveProxy>,
    pub counts: Counts,
    pub args: Vec<u32>,
    pub skin: Vec<[f32; 4]>,
    pub heights: Vec<u32>,
    pub names: Vec<u32>,
    pub hits: Vec<[f32; 4]>,
    pub what: Vec<[u32; 4]>,
    pub source: Vec<u32>,
    pub contacts: Vec<Contact>,
    pub entry_nodes: Vec<[u32; 4]>,
    pub entry_weights: Vec<[f32; 4]>,
    pub node_count: Vec<u32>,
    pub node_entries: Vec<[u32; 2]>,
    pub cursor: Vec<u32>,
    pub unsorted: Vec<u32>,
    pub sorted: Vec<[u32; 2]>,
}

/// At least one element, for an array that is bound but not read.
fn some<T: Pod>(data: &[T]) -> Vec<T> {
    if data.is_empty() { vec![T::zeroed()] } else { data.to_vec() }
}

/// A scene of which only the contact law and the time step matter.
fn scene() -> Scene {
    Scene {
        file: "none".into(),
        step: scene::Step { dt: 1e-3, gravity: DVec3::ZERO, newton: 1 },
        solver: scene::Solver { tolerance: 1e-5, max_iterations: 10, preconditioner: scene::Preconditioner::Auto },
        contact: scene::Contact {
            stiffness: Some(1e6),
            damping: Some(1e3),
            friction: 0.0,
            friction_speed: 1e-3,
            texel: None,
            depth_limit: 0.02,
        },
        bodies: vec![],
        tool: None,
        coupling: None,
        drive: vec![],
        haptics: scene::Haptics { device: "scripted".into(), rate: 1000.0, max_force: None },
        probes: vec![],
    }
}

impl Flow {
    /// Bodies where they are, positions relative to `origin`.
    pub fn new(bodies: &[Body], tool: Option<&Body>, origin: DVec3) -> Flow {
        let model = Model::new(&scene(), bodies, tool);
        let frame = |(centre, rotation): (DVec3, DQuat)| Frame {
            rotation: rotation.as_quat().to_array(),
            centre: (centre - origin).as_vec3().to_array(),
            ..Frame::default()
        };
        let frames =
            model.frames.iter().map(|f| frame((f.position + f.orientation * f.rest_centre, f.orientation))).collect();
        let mut pairs = model.pairs.clone();
        for (pair, plane) in pairs.iter_mut().zip(&model.pair_planes) {
            if let Some(p) = plane {
                pair.plane = texel(p.normal, p.offset - p.normal.dot(origin));
            }
        }
        let params = StepParams { dt: 1e-3, step: 7, depth_limit: 0.02, ..StepParams::zeroed() };
        let (nodes, velocity, capacity) = (model.node_rest.len(), model.velocity.clone(), model.candidates);
        Flow {
            params,
            frames,
            pairs,
            velocity,
            capacity,
            displacement: vec![[0.0; 4]; nodes],
            tile: 128,
            bounds: vec![],
            proxy_active: vec![0; model.active_slots],
            active_pairs: vec![],
            reach: vec![0.0; model.proxy_pairs.len()],
            directions: vec![[0.0; 4]; model.proxy_pairs.len()],
            regions: vec![],
            active_list: vec![],
            counts: Counts::default(),
            args: vec![0; args::WORDS],
            skin: vec![[0.0; 4]; model.skin_nodes.len()],
            node_count: vec![0; nodes],
            node_entries: vec![[0; 2]; nodes],
            hull: vec![],
            faces: vec![],
            heights: vec![],
            names: vec![],
            hits: vec![],
            what: vec![],
            source: vec![],
            contacts: vec![],
            entry_nodes: vec![],
            entry_weights: vec![],
            cursor: vec![],
            unsorted: vec![],
            sorted: vec![],
            model,
        }
    }

    /// Workgroups that the kernels before asked for.
    fn groups(&self, slot: u32) -> usize {
        self.args[3 * slot as usize] as usize
    }

    /// Everything up to the depths of skin vertices, by one of the two ways to rasterize.
    pub fn query(&mut self, path: Path) {
        self.place();
        self.bound();
        self.test_pairs();
        self.direct();
        self.regions();
        self.embed();
        match path {
            Path::Compute => self.raster(),
            Path::Graphics => self.draw(),
        }
        self.candidates();
    }

    /// What follows: the list of contacts, their response, the index from nodes to them.
    pub fn gather(&mut self) {
        self.compact();
        self.respond();
        self.place_entries();
        self.fill();
        self.sort();
    }

    pub fn place(&mut self) {
        let (hulls, faces) = (self.model.hull.len(), self.model.faces.len());
        let out = case("pose/place")
            .constant("HULL_VERTICES", hulls as u32)
            .constant("FACES", faces as u32)
            .constant("TETRAHEDRA", self.model.tetrahedra.len() as u32)
            .constant("GROUP", context().group_size())
            .input("frames", &self.frames)
            .input("hull_rest", &some(&self.model.hull))
            .input("face_rest", &some(&self.model.faces))
            .input("face_frame", &some(&self.model.face_frames))
            .output::<[f32; 4]>("hull", hulls)
            .output::<[f32; 4]>("faces", faces)
            .output::<Counts>("counts", 1)
            .partial("args", &self.args)
            .elements(hulls + faces)
            .run();
        self.hull = out.get("hull");
        self.faces = out.get("faces");
        self.counts = out.get("counts")[0];
        self.args = out.get("args");
    }

    pub fn bound(&mut self) {
        let out = case("skin/bound")
            .size(Size::Reduce)
            .input("proxies", &self.model.proxies)
            .input("hull", &some(&self.hull))
            .input("proxy_nodes", &some(&self.model.proxy_nodes))
            .input("displacement", &some(&self.displacement))
            .input("node_rest", &some(&self.model.node_rest))
            .input("links", &vec![Link::default(); self.model.links.len()])
            .output::<ProxyBounds>("bounds", self.model.proxies.len())
            .groups(self.model.proxies.len())
            .run();
        self.bounds = out.get("bounds");
    }

    pub fn test_pairs(&mut self) {
        let count = self.model.proxy_pairs.len();
        let out = case("cull/pairs")
            .constant("PROXY_PAIRS", count as u32)
            .input("params", &[self.params])
            .input("pairs", &self.pairs)
            .input("proxies", &self.model.proxies)
            .input("bounds", &self.bounds)
            .input("proxy_pairs", &some(&self.model.proxy_pairs))
            .input("hull", &some(&self.hull))
            .inout("proxy_active", &self.proxy_active)
            .partial("active_pairs", &vec![NONE; count])
            .partial("reach_of", &vec![0.0f32; count])
            .inout("args", &self.args)
            .elements(count)
            .run();
        self.proxy_active = out.get("proxy_active");
        self.active_pairs = out.get("active_pairs");
        self.reach = out.get("reach_of");
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
            .partial("directions", &vec![[0.0f32; 4]; self.model.proxy_pairs.len()])
            .groups(self.groups(args::DIRECTION))
            .run();
        self.directions = out.get("directions");
    }

    pub fn regions(&mut self) {
        let out = case("cull/regions")
            .size(Size::Reduce)
            .constant("PAIRS", self.pairs.len() as u32)
            .constant("TILE", self.tile)
            .constant("GROUP", context().group_size())
            .input("params", &[self.params])
            .input("pairs", &self.pairs)
            .input("proxies", &self.model.proxies)
            .input("bounds", &self.bounds)
            .input("hull", &some(&self.hull))
            .input("proxy_active", &self.proxy_active)
            .input("directions", &some(&self.directions))
            .output::<Region>("regions", self.pairs.len())
            .partial("active_list", &vec![ActiveProxy { proxy: NONE, ..Default::default() }; self.model.active_slots])
            .inout("counts", &[self.counts])
            .inout("args", &self.args)
            .groups(1)
            .run();
        self.regions = out.get("regions");
        self.active_list = out.get("active_list");
        self.counts = out.get("counts")[0];
        self.args = out.get("args");
    }

    pub fn embed(&mut self) {
        let out = case("skin/embed")
            .input("params", &[self.params])
            .input("frames", &self.frames)
            .input("counts", &[self.counts])
            .input("active_list", &some(&self.active_list))
            .input("proxies", &self.model.proxies)
            .input("proxy_embeds", &some(&self.model.proxy_embeds))
            .input("skin_nodes", &some(&self.model.skin_nodes))
            .input("skin_weights", &some(&self.model.skin_weights))
            .input("node_rest", &some(&self.model.node_rest))
            .input("displacement", &some(&self.displacement))
            .input("node_info", &some(&self.model.node_info))
            .partial("skin", &self.skin)
            .groups(self.groups(args::EMBED))
            .run();
        self.skin = out.get("skin");
    }

    /// The compute path: least heights, then least triangles.
    pub fn raster(&mut self) {
        let texels = 2 * self.pairs.len() * (self.tile * self.tile) as usize;
        (self.heights, self.names) = (vec![u32::MAX; texels], vec![NONE; texels]);
        for naming in [false, true] {
            let heights = &self.heights;
            let given = case("depth/raster")
                .constant("NAMES", naming)
                .constant("TILE", self.tile)
                .input("counts", &[self.counts])
                .input("active_list", &some(&self.active_list))
                .input("proxies", &self.model.proxies)
                .input("proxy_triangles", &some(&self.model.proxy_triangles))
                .input("regions", &self.regions)
                .input("triangles", &some(&self.model.triangles))
                .input("skin", &some(&self.skin));
            let given = if naming { given.input("heights", heights) } else { given.inout("heights", heights) };
            let out = given.inout("names", &self.names).groups(self.groups(args::RASTER)).run();
            self.heights = out.get("heights");
            let names = out.get::<u32>("names");
            assert!(naming || names == self.names, "the first pass names no triangle");
            self.names = names;
        }
    }

    /// The graphics path; heights are the depths of the target.
    pub fn draw(&mut self) {
        let (context, tiles) = (context(), 2 * self.pairs.len() as u32);
        let constants = [("TILE", self.tile.into()), ("TILES", tiles.into())];
        let pipeline = RasterPipeline::new(context, "depth/depth", DepthTest::Less, &constants).unwrap();
        let target = RasterTarget::new(context, "tiles", self.tile, self.tile * tiles).unwrap();
        fn on_device<T: Pod>(name: &str, data: &[T]) -> Buffer {
            Buffer::from_slice(crate::harness::context(), name, &some(data), Memory::Device).unwrap()
        }
        let model = &self.model;
        let buffers = [
            on_device("counts", &[self.counts]),
            on_device("active_list", &self.active_list),
            on_device("proxies", &model.proxies),
            on_device("proxy_triangles", &model.proxy_triangles),
            on_device("regions", &self.regions),
            on_device("triangles", &model.triangles),
            on_device("skin", &self.skin),
        ];
        let bound: Vec<_> = pipeline.bindings().iter().map(|b| b.name.as_str()).collect();
        assert_eq!(bound, buffers.iter().map(|b| b.name()).collect::<Vec<_>>());
        let draw = on_device("args", &self.args);
        let bytes = u64::from(tiles) * u64::from(self.tile * self.tile) * 4;
        let out = |name| Buffer::new(context, name, bytes, Memory::Readback).unwrap();
        let (names, depths) = (out("names"), out("depths"));
        let mut recorder = Recorder::new(context).unwrap();
        recorder.stage("depth");
        let handles: Vec<_> = buffers.iter().collect();
        recorder.draw_indirect(&pipeline, &target, &handles, &[], &draw, args::DRAW, Pass::cleared(NONE, 1.0));
        recorder.copy_target(&target, &names, &depths);
        recorder.finish().and_then(|r| r.submit_and_wait()).unwrap();
        assert_clean(context, "depth/depth");
        (self.names, self.heights) = (names.read().unwrap(), depths.read().unwrap());
    }

    pub fn candidates(&mut self) {
        let (count, model) = (self.counts.vertices as usize, &self.model);
        let out = case("contact/candidates")
            .constant("TILE", self.tile)
            .input("params", &[self.params])
            .inout("counts", &[self.counts])
            .input("active_list", &some(&self.active_list))
            .input("proxies", &model.proxies)
            .input("proxy_vertices", &some(&model.proxy_vertices))
            .input("pairs", &self.pairs)
            .input("regions", &self.regions)
            .input("names", &some(&self.names))
            .input("triangles", &some(&model.triangles))
            .input("neighbours", &some(&model.neighbours))
            .input("skin", &some(&self.skin))
            .input("fan_first", &model.fan_first)
            .input("fans", &some(&model.fans))
            .input("areas", &some(&model.skin_areas))
            .output::<[f32; 4]>("candidate_hits", count)
            .output::<[u32; 4]>("candidate_what", count)
            .groups(self.groups(args::CANDIDATES))
            .run();
        self.counts = out.get("counts")[0];
        self.hits = out.get("candidate_hits");
        self.what = out.get("candidate_what");
    }

    pub fn compact(&mut self) {
        let out = case("contact/compact")
            .size(Size::Reduce)
            .constant("CAPACITY", self.capacity as u32)
            .constant("NODES", self.model.node_rest.len() as u32)
            .constant("TETRAHEDRA", self.model.tetrahedra.len() as u32)
            .constant("GROUP", context().group_size())
            .input("candidate_hits", &some(&self.hits))
            .inout("counts", &[self.counts])
            .partial("contact_source", &vec![NONE; self.capacity])
            .partial("args", &self.args)
            .groups(self.groups(args::COMPACT))
            .run();
        self.counts = out.get("counts")[0];
        self.source = out.get("contact_source");
        self.args = out.get("args");
    }

    pub fn respond(&mut self) {
        let (contacts, model) = (self.counts.contacts as usize, &self.model);
        let out = case("contact/response")
            .constant("FRICTION_COEFFICIENT", model.friction[0])
            .constant("FRICTION_SPEED", model.friction[1])
            .input("params", &[self.params])
            .input("counts", &[self.counts])
            .input("pairs", &self.pairs)
            .input("regions", &self.regions)
            .input("contact_source", &some(&self.source))
            .input("candidate_hits", &some(&self.hits))
            .input("candidate_what", &some(&self.what))
            .input("triangles", &some(&model.triangles))
            .input("skin_nodes", &some(&model.skin_nodes))
            .input("skin_weights", &some(&model.skin_weights))
            .input("skin", &some(&self.skin))
            .input("velocity", &some(&self.velocity))
            .input("frames", &self.frames)
            .output::<Contact>("contacts", contacts)
            .partial("entry_nodes", &vec![[NONE; 4]; 4 * contacts])
            .partial("entry_weights", &vec![[0.0f32; 4]; 4 * contacts])
            .inout("node_count", &self.node_count)
            .groups(self.groups(args::CONTACTS))
            .run();
        self.contacts = out.get("contacts");
        self.entry_nodes = out.get("entry_nodes");
        self.entry_weights = out.get("entry_weights");
        self.node_count = out.get("node_count");
    }

    pub fn place_entries(&mut self) {
        let nodes = self.node_count.len();
        let out = case("contact/place")
            .constant("NODES", nodes as u32)
            .input("node_count", &some(&self.node_count))
            .inout("counts", &[self.counts])
            .partial("node_entries", &self.node_entries)
            .partial("cursor", &vec![NONE; nodes])
            .groups(self.groups(args::CONTACT_NODES))
            .run();
        self.counts = out.get("counts")[0];
        self.node_entries = out.get("node_entries");
        self.cursor = out.get("cursor");
    }

    pub fn fill(&mut self) {
        let out = case("contact/fill")
            .input("counts", &[self.counts])
            .input("contacts", &some(&self.contacts))
            .input("entry_nodes", &some(&self.entry_nodes))
            .input("entry_weights", &some(&self.entry_weights))
            .inout("cursor", &self.cursor)
            .partial("unsorted", &vec![NONE; self.counts.entries as usize])
            .groups(self.groups(args::ENTRIES))
            .run();
        self.cursor = out.get("cursor");
        self.unsorted = out.get("unsorted");
    }

    pub fn sort(&mut self) {
        let out = case("contact/sort")
            .input("counts", &[self.counts])
            .input("contacts", &some(&self.contacts))
            .input("entry_nodes", &some(&self.entry_nodes))
            .input("entry_weights", &some(&self.entry_weights))
            .input("node_entries", &some(&self.node_entries))
            .input("unsorted", &some(&self.unsorted))
            .partial("sorted", &vec![[NONE; 2]; self.counts.entries as usize])
            .groups(self.groups(args::ENTRIES))
            .run();
        self.sorted = out.get("sorted");
    }
}
