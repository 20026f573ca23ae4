//! The kernels from pose to contact, which are the proximity query and the contact response. Each kernel runs in the
//! test harness on the arrays that the kernel before it wrote, so that tests can check the whole query while the
//! harness checks each kernel. A pair proxy is a collision proxy (convex hull) in a pair of bodies; a side is body a or
//! b of a pair; a chunk is a group of up to 64 skin vertices with their triangles; a contact patch is a place where a
//! pair may touch along one normal; a work item is a chunk in a patch; a hash entry is one vertex of a work item in the
//! spatial hash; a candidate is a skin vertex that may be a contact; a contact entry is a node with its weight in a
//! contact.

mod contact;
mod query;

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};
use palpate::Scene;
use palpate::internal::prepare::Body;
use palpate::internal::shaders;
use palpate::internal::shaders::{
    ActiveChunk, Contact, ContactPatch, Counts, Frame, Link, NONE, Overlap, Pair, ProxyBounds, StepParams,
};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::PAIR_PATCHES;
use palpate::internal::stages::depth::Path;
use palpate::internal::stages::model::{Model, texel};
use palpate::internal::stages::skin::LEAST_BUCKETS;
use palpate::scene::{self, Samples, Sides};

use crate::harness::context;

/// The depth paths (implementations of the stage that finds ray hits) that the flow can run.
pub const PATHS: [Path; 1] = [Path::Compute];
/// Number of cells in the two min-max depth grids of a contact patch (how far each side reaches along the normal):
/// 16 x 16 for each side.
pub const GRID_WORDS: usize = 2 * 16 * 16;
/// A box, given by its least and its greatest corner.
pub type Box3 = [[f32; 3]; 2];

/// Inputs and outputs of the kernels, as the host reads them.
pub struct Flow {
    pub model: Model,
    pub params: StepParams,
    pub frames: Vec<Frame>,
    pub links: Vec<Link>,
    pub pairs: Vec<Pair>,
    pub displacement: Vec<[f32; 4]>,
    pub velocity: Vec<[f32; 4]>,
    /// Change of each node's velocity over the last step.
    pub solution: Vec<[f32; 4]>,
    /// Change of the tool's twist over the last step.
    pub tool_change: [f32; 6],
    /// Length of the step in which the changes of velocity came about, s; 0: they are not to be used.
    pub solution_dt: f32,
    pub max_work_items: usize,
    pub most_hits: usize,
    pub bucket_count: u32,
    pub capacity: usize,
    pub hull: Vec<[f32; 4]>,
    pub faces: Vec<[f32; 4]>,
    pub bounds: Vec<ProxyBounds>,
    pub active_pairs: Vec<u32>,
    pub reach: Vec<[f32; 2]>,
    /// Two elements for each two proxies of different bodies: the unit normal with the weight that it has in the mean
    /// normal of the two bodies, and the push (sum of depth times area times normal over their contacts in the last step)
    /// with its length.
    pub directions: Vec<[f32; 4]>,
    /// [`PAIR_PATCHES`] contact patches for each pair of bodies.
    pub contact_patches: Vec<ContactPatch>,
    /// [`PAIR_PATCHES`] elements for each pair proxy, as in `boxes`: the weight of each contact patch at the proxy's
    /// vertices, by which their depths in several patches are blended.
    pub shares: Vec<f32>,
    pub boxes: Vec<Box3>,
    pub proxy_patches: Vec<u32>,
    pub pair_proxy_counts: Vec<[u32; 2]>,
    pub active_pair_proxies: Vec<u32>,
    pub depth_grids: Vec<u32>,
    pub pair_proxy_chunks: Vec<[u32; 2]>,
    /// [`PAIR_PATCHES`] elements for each chunk of a pair proxy. Each has the chunk's box in a patch: least and
    /// greatest corner in the patch's plane, an inclined plane that bounds the chunk towards the other body, and the
    /// chunk's greatest height towards that body.
    pub slabs: Vec<[f32; 8]>,
    pub active_chunks: Vec<ActiveChunk>,
    pub work_items: Vec<[u32; 2]>,
    pub counts: Counts,
    pub args: Vec<u32>,
    pub skin: Vec<[f32; 4]>,
    pub buckets: Vec<u32>,
    /// Hash entries: bits of the vertex's position along the patch's axes, and the next hash entry of the same bucket.
    pub hash_entries: Vec<[u32; 4]>,
    pub entry_hits: Vec<u32>,
    pub entry_cells: Vec<[u32; 2]>,
    /// Ray hits: triangle, next hit on the same ray, bits of the depth, and twice the triangle's work item, plus 1
    /// for a front face (through which the ray leaves the triangle's body).
    pub ray_hits: Vec<[u32; 4]>,
    pub most_overlaps: usize,
    pub overlaps: Vec<Overlap>,
    /// The overlap, or NONE, of each triangle of each work item.
    pub overlap_at: Vec<u32>,
    pub hits: Vec<[f32; 4]>,
    pub what: Vec<[u32; 4]>,
    pub normals: Vec<[f32; 4]>,
    pub pushes: Vec<[f32; 4]>,
    pub source: Vec<u32>,
    /// One bit for each candidate, which is set if the candidate collides.
    pub chunk_contacts: Vec<u32>,
    pub contacts: Vec<Contact>,
    pub entry_nodes: Vec<[u32; 4]>,
    pub entry_weights: Vec<[f32; 4]>,
    pub node_list_counts: Vec<u32>,
    pub node_entries: Vec<[u32; 2]>,
    /// The contact entry that was last put on each of a node's lists, or NONE. A node has as many lists as a workgroup
    /// of contact/sort has lanes.
    pub node_lists: Vec<u32>,
    pub next_entries: Vec<u32>,
    pub touched_nodes: Vec<u32>,
    pub sorted: Vec<[u32; 2]>,
}

/// The data, or a single zero element if there are no data, for an array that is bound but not read.
pub fn some<T: Pod>(data: &[T]) -> Vec<T> {
    if data.is_empty() { vec![T::zeroed()] } else { data.to_vec() }
}

/// The data as from [`some`], filled up with zeros to whole texels of four words.
pub fn fours<T: Pod>(data: &[T]) -> Vec<T> {
    let mut data = some(data);
    data.resize(data.len().next_multiple_of(4), T::zeroed());
    data
}

/// Pairs of words, such as a node and its link (transform between two frames), two in each texel of four words.
pub fn pairs(data: &[[u32; 2]]) -> Vec<u32> {
    fours(data.as_flattened())
}

/// A scene of which only the contact law and the time step are used.
fn scene(sides: Sides, samples: Samples) -> Scene {
    Scene {
        file: "none".into(),
        step: scene::Step { dt: 1e-3, gravity: DVec3::ZERO, newton: 1 },
        solver: scene::Solver {
            tolerance: Some(1e-5),
            max_iterations: 10,
            preconditioner: scene::Preconditioner::Auto,
            operator: scene::Operator::Auto,
        },
        contact: scene::Contact {
            stiffness: Some(1e6),
            damping: Some(1e3),
            friction: 0.0,
            friction_speed: 1e-3,
            texel: None,
            depth_limit: 0.02,
            depth: None,
            sides,
            samples,
        },
        bodies: vec![],
        tool: None,
        further_tools: vec![],
        coupling: None,
        trajectory: vec![],
        haptics: scene::Haptics::default(),
        probes: vec![],
        preset: None,
    }
}

impl Flow {
    /// The inputs for these bodies at their places, with positions relative to `origin`.
    pub fn new(bodies: &[Body], tool: Option<&Body>, origin: DVec3) -> Flow {
        Flow::of_sides(bodies, tool, origin, Sides::Both)
    }

    /// A flow like that of [`Flow::new`], where `sides` chooses whose vertices are tested for contact.
    pub fn of_sides(bodies: &[Body], tool: Option<&Body>, origin: DVec3, sides: Sides) -> Flow {
        Flow::of(bodies, tool, origin, sides, Samples::Vertices)
    }

    /// A flow like that of [`Flow::of_sides`], where `samples` chooses what of a skin is tested for contact.
    pub fn of(bodies: &[Body], tool: Option<&Body>, origin: DVec3, sides: Sides, samples: Samples) -> Flow {
        let model = Model::new(&scene(sides, samples), bodies, tool);
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
        let nodes = model.node_rest.len();
        Flow {
            params: StepParams { dt: 1e-3, depth_limit: 0.02, ..StepParams::zeroed() },
            frames,
            links: vec![Link::default(); model.links.len()],
            velocity: model.velocity.clone(),
            solution: vec![[0.0; 4]; nodes],
            tool_change: [0.0; 6],
            solution_dt: 0.0,
            displacement: vec![[0.0; 4]; nodes],
            max_work_items: model.max_work_items(),
            most_hits: 1 << 16,
            bucket_count: LEAST_BUCKETS,
            capacity: model.slots() * model.most_gathering(),
            hull: vec![],
            faces: vec![],
            bounds: vec![],
            active_pairs: vec![],
            reach: vec![],
            directions: vec![],
            contact_patches: vec![ContactPatch::default(); PAIR_PATCHES * pairs.len()],
            shares: vec![],
            boxes: vec![],
            proxy_patches: vec![],
            pair_proxy_counts: vec![],
            active_pair_proxies: vec![],
            depth_grids: vec![],
            pair_proxy_chunks: vec![],
            slabs: vec![],
            active_chunks: vec![],
            work_items: vec![],
            counts: Counts::default(),
            args: vec![0; ARGS_WORDS],
            skin: vec![[0.0; 4]; model.skin_nodes.len()],
            buckets: vec![],
            hash_entries: vec![],
            entry_hits: vec![],
            entry_cells: vec![],
            ray_hits: vec![],
            most_overlaps: 1 << 14,
            overlaps: vec![],
            overlap_at: vec![],
            hits: vec![],
            what: vec![],
            normals: vec![],
            pushes: vec![],
            source: vec![],
            chunk_contacts: vec![],
            contacts: vec![],
            entry_nodes: vec![],
            entry_weights: vec![],
            node_list_counts: vec![0; nodes],
            node_entries: vec![[0; 2]; nodes],
            node_lists: vec![NONE; nodes * context().reduce_size() as usize],
            next_entries: vec![],
            touched_nodes: vec![],
            sorted: vec![],
            pairs,
            model,
        }
    }

    /// Number of workgroups that earlier kernels requested for dispatch `args_index` of the indirect arguments.
    fn groups(&self, args_index: u32) -> usize {
        self.args[3 * args_index as usize] as usize
    }

    /// Runs everything up to the depths of skin vertices, on the depth path `path`.
    pub fn query(&mut self, path: Path) {
        self.place();
        self.cull();
        self.embed();
        match path {
            Path::Compute => self.cross(),
            Path::Graphics => unreachable!("Path::Graphics is not among PATHS"),
        }
        if self.model.needs_overlaps() {
            self.overlap();
        }
        self.candidates();
    }

    /// Runs the culling kernels: from placed hulls to the list of active chunks.
    pub fn cull(&mut self) {
        self.test_pairs();
        self.direct();
        self.find_contact_patches();
        self.box_chunks();
        self.meet();
    }

    /// Runs the kernels that follow the query, which make the list of contacts, the coefficients of contacts, and the
    /// index from nodes to contacts.
    pub fn gather(&mut self) {
        self.deepest();
        self.respond();
        self.sort();
    }

    /// Clears the contact entries of this many nodes.
    pub fn forget_entries(&mut self, nodes: usize) {
        self.node_list_counts = vec![0; nodes];
        self.node_entries = vec![[0; 2]; nodes];
        self.node_lists = vec![NONE; nodes * context().reduce_size() as usize];
        self.args[3 * shaders::ARGS_NODES as usize] = 0;
    }
}
