//! The model: the static arrays that the kernels read, made from the prepared bodies, one body after another, with
//! global indices and with f32 positions relative to the centre of a coordinate frame. The model is made before the
//! first step and does not change from step to step.
//!
//! The terms are those of layered bodies: a soft body is a tetrahedral mesh (layer) with an embedded surface mesh
//! (skin), and some nodes are attached to rigid bodies inside it (cores), each with a rigid coordinate frame. Convex
//! hulls (proxies) cover the skin, which is divided into chunks, groups of at most 64 vertices. A pair proxy is one
//! proxy in one pair of bodies; a chunk of it is active in a step if it may meet the other body. A contact patch is an
//! area with one normal where a pair of bodies may touch. A vertex gathers contacts if it is tested for contact with
//! the other body; a scene may have the vertices of only one body of each pair tested.

use crate::shaders;
use std::ops::Range;

use glam::{DQuat, DVec3};

use super::blocks::Blocks;
use super::coarse::Coarse;
use super::contact_law::{Law, Yielding};
use super::gap;
use super::joints::Joint;
use super::layers::OF_PATCH;
use super::loads::Loads;
use super::mean_dilatation::Patches;
use super::supports::Held;
use crate::prepare::patch::MOST_NODES;
use crate::prepare::{Body, Embedding, FrameMotion, Layer, Shape, Skin};
use crate::scene::check::MOST_TOOLS;
use crate::scene::{Operator, Samples, Scene, Sides};
use crate::shaders::{Chunk, ElasticMaterial, NONE, Pair, PairProxy, Proxy};
use crate::stages::PAIR_PATCHES;

/// Largest number of work items (an active chunk in one contact patch each). Any GPU can run that many workgroups, one
/// per work item, and that many chunks have up to four million vertices. More work items raise the flag
/// `PATCH_OVERFLOW`.
const MAX_WORK_ITEMS: usize = (1 << 16) - 1;

const _: () = assert!(MOST_TOOLS == shaders::MOST_TOOLS as usize);

/// A rigid coordinate frame of a body, as placed in the scene.
#[derive(Debug, Clone)]
pub struct FramePlace {
    /// World position of the origin of the body's rest frame, m.
    pub position: DVec3,
    /// Rotation from the body's rest frame to the world.
    pub orientation: DQuat,
    /// The frame's centre in the body's rest frame, m.
    pub rest_centre: DVec3,
    /// How the frame moves.
    pub motion: Motion,
}

/// How a frame moves.
#[derive(Debug, Clone)]
pub enum Motion {
    /// The frame moves as the scene says.
    Prepared(FrameMotion),
    /// The frame is the tool's.
    Tool,
}

/// A half-space in world coordinates, normal . x <= offset.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// Unit outward normal.
    pub normal: DVec3,
    /// Offset along the normal, m.
    pub offset: f64,
}

/// Where a soft body's nodes lie in the arrays.
#[derive(Debug, Clone)]
pub struct SoftRange {
    /// Index of the body.
    pub body: usize,
    /// Range of its nodes.
    pub nodes: Range<usize>,
}

/// The tetrahedral mesh of a soft body and the embedding of its skin in it.
pub(super) struct Carrier<'a> {
    pub layer: &'a Layer,
    pub embedding: &'a [Embedding],
    pub node_first: usize,
}

/// A floating frame (of a body without cores), and the nodes to which it is fitted.
#[derive(Debug, Clone)]
pub struct Floating {
    /// Index of the frame.
    pub frame: usize,
    /// Range of the nodes.
    pub nodes: Range<usize>,
}

/// A dynamic core: a rigid frame that forces move, and the nodes attached to it.
#[derive(Debug, Clone)]
pub struct Core {
    /// Index of its frame.
    pub frame: usize,
    /// The nodes attached to it.
    pub nodes: Vec<u32>,
    /// Unit axis of the core's hinge, which runs through the frame's centre, in world axes; zero for a core without a
    /// hinge.
    pub hinge: DVec3,
    /// Range of the cores that joints connect with it, itself included (its group); in a group, each core comes after
    /// its parent.
    pub group: Range<usize>,
    /// Its parent in the tree of joints.
    pub parent: Option<usize>,
}

/// The static arrays of a scene.
#[derive(Debug, Default)]
pub struct Model {
    /// The frames of all bodies, and the tool's.
    pub frames: Vec<FramePlace>,
    /// Friction coefficient, and the speed below which friction is viscous, m/s.
    pub friction: [f32; 2],
    /// Newton iterations per step.
    pub newton: u32,
    /// Whether the solver assembles its operator.
    pub assembles: bool,
    /// The materials of all bodies.
    pub materials: Vec<ElasticMaterial>,
    /// Per body: its first frame; `NONE` for a half-space.
    pub body_frames: Vec<u32>,
    /// Links: the pairs of frames (to, from) in both of which a tetrahedron, proxy or chunk has nodes; the first link
    /// stands for any frame paired with itself.
    pub links: Vec<[u32; 2]>,
    /// The nodes attached to moving frames, which are frames that follow a trajectory (driven frames) and frames of
    /// dynamic cores.
    pub attached_nodes: Vec<u32>,
    /// The dynamic cores.
    pub cores: Vec<Core>,
    /// The joints between frames.
    pub joints: Vec<Joint>,
    /// The division of the nodes into blocks, each of which one workgroup of the solver works on.
    pub blocks: Blocks,
    /// The coarse space of the solver's preconditioner, for the bodies that have one.
    pub coarse: Coarse,
    /// The floating frames.
    pub floating: Vec<Floating>,
    /// The frame of the tool, where the tool is no body of the scene.
    pub tool_frame: Option<usize>,
    /// Radius of the tool, where the tool is a sphere, m.
    pub tool_sphere: Option<f64>,
    /// Radius of the ball about a rigid tool's centre that contains the whole tool, m.
    pub tool_radius: f64,
    /// The dynamic cores that haptic devices are coupled to, tool by tool, where the tools are bodies of the scene.
    pub tool_cores: Vec<usize>,
    /// The soft bodies.
    pub soft: Vec<SoftRange>,

    /// Per node: rest position relative to its frame's centre (m), and mass (kg).
    pub node_rest: Vec<[f32; 4]>,
    /// Per node: mass-proportional damping, kg/s: the node's share of the mass of its tetrahedra, times the coefficient
    /// alpha (1/s) of mass-proportional damping of their materials.
    pub node_damping: Vec<f32>,
    /// Per node: its first quad (uvec4) in `node_elements`, number of quads, frame, and 0 for a free node, 1 for a node
    /// attached to a frame whose motion is known, 2 for a node attached to a dynamic core.
    pub node_info: Vec<[u32; 4]>,
    /// The entries of `element_forces` (the elastic stage's array of forces that elements exert on nodes) that add up
    /// at each node, node by node, four per texel.
    pub node_elements: Vec<[u32; 4]>,
    /// What holds the soft bodies: supports, and the cores whose reactions are reported.
    pub held: Held,
    /// Loads on the bodies.
    pub loads: Loads,
    /// Per node: velocity at the start, world axes, m/s.
    pub velocity: Vec<[f32; 4]>,
    /// Per tetrahedron: its four nodes.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Per tetrahedron: links from its frame (the frame of its first node) to the frames of its four nodes.
    pub tetrahedron_links: Vec<[u32; 4]>,
    /// Three vectors per tetrahedron, and three zero vectors at the end: rest gradients of its last three nodes' shape
    /// functions (1/m); w of the first is the square root of the tetrahedron's volume (in m^3).
    pub rest_gradients: Vec<[f32; 4]>,
    /// Per tetrahedron: its material and frame.
    pub element_info: Vec<[u32; 2]>,
    /// For each tetrahedron that can deform, or shares an F-bar patch with one that can: its index, material and frame,
    /// and a zero. The others lie within one rigid core. Where none can deform, all are listed.
    pub deforming: Vec<[u32; 4]>,

    /// F-bar patches, which are groups of tetrahedra that share one volumetric strain.
    pub patches: Patches,

    /// Per skin vertex: the four nodes of its tetrahedron; the first is `NONE` on a rigid body.
    pub skin_nodes: Vec<[u32; 4]>,
    /// Per skin vertex: its four embedding weights, or on a rigid body its position in the body's frame (m).
    pub skin_weights: Vec<[f32; 4]>,
    /// Per skin vertex: rest area, m^2.
    pub skin_areas: Vec<f32>,
    /// Per triangle: its three skin vertices, and its stiffening (`tips.rs`) as bits of an f32.
    pub triangles: Vec<[u32; 4]>,
    /// Per skin vertex: where its triangles begin in `fans`; at the end, the length of `fans`.
    pub fan_first: Vec<u32>,
    /// The triangles around each skin vertex, vertex by vertex.
    pub fans: Vec<u32>,

    /// The collision proxies of all bodies.
    pub proxies: Vec<Proxy>,
    /// Hull vertices of the proxies, relative to their frame's centre, m.
    pub hull: Vec<[f32; 4]>,
    /// Face planes of the hulls in their frame: unit normal, and offset from the frame's centre (m).
    pub faces: Vec<[f32; 4]>,
    /// The nodes whose displacements move the skin that a proxy covers, proxy by proxy, each with the link from the
    /// proxy's frame to the node's frame.
    pub proxy_nodes: Vec<[u32; 2]>,
    /// The chunks of all proxies.
    pub chunks: Vec<Chunk>,
    /// Skin vertices of the chunks, chunk by chunk, padded with up to three zeros.
    pub chunk_vertices: Vec<u32>,
    /// Triangles of the chunks, chunk by chunk, padded with up to three zeros.
    pub chunk_triangles: Vec<u32>,
    /// The nodes whose displacements move each chunk, chunk by chunk, each with the link from the frame of the chunk's
    /// proxy to the node's frame.
    pub chunk_nodes: Vec<[u32; 2]>,

    /// Pairs of bodies that may touch; the host writes the planes of half-spaces anew in each step.
    pub pairs: Vec<Pair>,
    /// Per pair: indices of its bodies a and b; the tool's index comes after those of the scene's bodies.
    pub pair_bodies: Vec<[usize; 2]>,
    /// Per pair: how its softer body yields; `None` where both are rigid.
    pub pair_softer: Vec<Option<Yielding>>,
    /// Per pair: its half-space, if it has one.
    pub pair_planes: Vec<Option<Plane>>,
    /// Pairs of collision proxies: a proxy of body a, a proxy of body b, 0, 0.
    pub proxy_pairs: Vec<[u32; 4]>,
    /// The pair proxies of all pairs of bodies.
    pub pair_proxies: Vec<PairProxy>,
    /// Number of the chunks of all pair proxies together.
    pub pair_proxy_chunks: usize,
    /// Number of pair proxies whose vertices gather contacts; these come first in `pair_proxies`.
    pub gathering_pair_proxies: usize,
    /// Number of chunks of the pair proxies whose vertices gather contacts.
    pub gathering_chunks: usize,
}

impl Model {
    /// The model of a scene's bodies; the tool's own body, if it has one, comes last.
    pub fn new(scene: &Scene, bodies: &[Body], tool: Option<&Body>) -> Model {
        Model::made(scene, bodies, tool, None)
    }

    /// A model of the same bodies with other materials or another contact law: the new model's arrays have the same
    /// sizes, its blocks of nodes are the same, and the same bodies have a coarse space.
    pub fn with_materials_of(&self, scene: &Scene, bodies: &[Body], tool: Option<&Body>) -> Model {
        Model::made(scene, bodies, tool, Some(self))
    }

    fn made(scene: &Scene, bodies: &[Body], tool: Option<&Body>, before: Option<&Model>) -> Model {
        let all: Vec<&Body> = bodies.iter().chain(tool).collect();
        let (mut model, proxy_ranges) = Model::of_bodies(&all, bodies.len());
        model.group_cores();
        model.stiffen_joints(scene.step.dt);
        match before {
            Some(before) => model.add_coarse_like(scene.longest_step(), before),
            None => model.add_coarse(scene.longest_step(), &scene.solver),
        }
        model.friction = [scene.contact.friction as f32, scene.contact.friction_speed as f32];
        model.newton = scene.step.newton;
        model.assembles = scene.solver.operator == Operator::Auto
            && model.patches.count() == 0
            && model.node_rest.len() <= shaders::ROW_NODES as usize;
        model.tool_sphere = scene.tool.as_ref().and_then(|tool| tool.shape.radius());
        let core_of = |body: usize| model.cores.iter().position(|core| core.frame == model.body_frames[body] as usize);
        model.tool_cores = scene.tool_bodies().map(core_of).collect::<Option<_>>().unwrap_or_default();
        model.add_pairs(scene, &all, tool.is_some(), &proxy_ranges);
        model.tool_radius = gap::tool_radius(&model);
        model
    }

    /// The model of two bodies for the proximity query: one pair, whether the bodies can move or not.
    pub fn of_query(a: &Body, b: &Body) -> Model {
        let all = [a, b];
        let (mut model, proxy_ranges) = Model::of_bodies(&all, all.len());
        // No force is computed from this pair, so its contact law has no effect.
        let law = Law { stiffness: 1.0, damping: 0.0, softer: None, stiffens_tips: [false; 2] };
        model.add_pair(&all, (0, 1), &[], &proxy_ranges, law, (Sides::Both, Samples::Vertices));
        model.add_pair_proxies();
        model
    }

    /// The arrays of bodies without their pairs, and the range of each body's proxies. `tool`: index of the tool's own
    /// body.
    fn of_bodies(all: &[&Body], tool: usize) -> (Model, Vec<Range<usize>>) {
        let mut model = Model { links: vec![[0, 0]], fan_first: vec![0], ..Model::default() };
        let mut proxy_ranges = Vec::new();
        for (index, body) in all.iter().enumerate() {
            let first = model.proxies.len();
            model.add_body(index, body, index == tool);
            proxy_ranges.push(first..model.proxies.len());
        }
        if model.deforming.is_empty() {
            let info = model.element_info.iter().zip(0..);
            model.deforming = info.map(|([material, frame], t)| [t, *material, *frame, 0]).collect();
        }
        // The gradients, all zero, of an additional tetrahedron, to which the padding of lists of tetrahedra points.
        model.rest_gradients.extend([[0.0; 4]; 3]);
        (model, proxy_ranges)
    }

    fn add_body(&mut self, index: usize, body: &Body, is_tool: bool) {
        match &body.shape {
            Shape::Plane { .. } => self.body_frames.push(NONE),
            Shape::Soft { layer, frames, node_frames, supports, joints, materials, embedding, skin, proxies } => {
                let frame_first = self.frames.len();
                self.body_frames.push(frame_first as u32);
                for frame in frames {
                    self.add_frame(body, frame.centre, Motion::Prepared(frame.motion.clone()));
                }
                let node_first = self.node_rest.len();
                self.add_layer(layer, node_frames, materials, frame_first, body.velocity);
                self.add_supports(&body.name, body.orientation, supports, node_first);
                self.add_joints(joints, frame_first);
                self.add_loads(body, node_first, frame_first);
                let nodes = node_first..self.node_rest.len();
                if let FrameMotion::Floating { .. } = frames[0].motion {
                    self.floating.push(Floating { frame: frame_first, nodes: nodes.clone() });
                }
                self.soft.push(SoftRange { body: index, nodes });
                let vertex_first = self.skin_nodes.len();
                for e in embedding {
                    let nodes = layer.tetrahedra[e.tetrahedron as usize].map(|n| n + node_first as u32);
                    self.skin_nodes.push(nodes);
                    self.skin_weights.push(e.weights.map(|w| w as f32));
                }
                self.add_skin(skin, vertex_first);
                let carrier = Carrier { layer, embedding, node_first };
                self.add_proxies(skin, proxies, frame_first, vertex_first, Some(&carrier));
            }
            Shape::Rigid { skin, proxies, centroid, motion, volume, inertia } => {
                let frame = self.frames.len();
                self.body_frames.push(frame as u32);
                let mover = if is_tool { Motion::Tool } else { Motion::Prepared(motion.clone()) };
                let centre = match motion {
                    FrameMotion::Dynamic { hinge: Some(hinge), .. } if !is_tool => hinge.point,
                    _ => *centroid,
                };
                self.add_frame(body, centre, mover);
                self.tool_frame = if is_tool { Some(frame) } else { self.tool_frame };
                let vertex_first = self.skin_nodes.len();
                match motion {
                    FrameMotion::Dynamic { mass, .. } if !is_tool => {
                        let mass = mass.unwrap_or_default();
                        self.add_masses(frame, (mass, *centroid, *inertia * (mass / volume)), body.velocity, skin);
                    }
                    _ => {
                        for x in &skin.vertices {
                            self.skin_nodes.push([NONE, 0, 0, 0]);
                            self.skin_weights.push(texel(*x - *centroid, 0.0));
                        }
                    }
                }
                self.add_loads(body, 0, frame);
                self.add_skin(skin, vertex_first);
                self.add_proxies(skin, proxies, frame, vertex_first, None);
            }
        }
    }

    fn add_frame(&mut self, body: &Body, rest_centre: DVec3, motion: Motion) {
        let Body { position, orientation, .. } = *body;
        self.frames.push(FramePlace { position, orientation, rest_centre, motion });
    }

    /// The index of the link from frame `to` to frame `from`, which maps points attached to `from` into `to`; the link
    /// is added if it is new.
    pub(super) fn link(&mut self, to: u32, from: u32) -> u32 {
        if to == from {
            return 0;
        }
        let known = self.links.iter().skip(1).position(|link| *link == [to, from]);
        known.map_or_else(
            || {
                self.links.push([to, from]);
                self.links.len() as u32 - 1
            },
            |at| at as u32 + 1,
        )
    }

    /// Whether a node is free, so that the solver decides its motion.
    pub fn is_free(&self, node: usize) -> bool {
        self.node_info[node][3] == shaders::NODE_FREE
    }

    /// Whether a node is attached to a dynamic core.
    pub fn is_attached(&self, node: usize) -> bool {
        self.node_info[node][3] == shaders::NODE_ATTACHED
    }

    /// The dynamic core that the first haptic device is coupled to, where the tool is a body of the scene.
    pub fn tool_core(&self) -> Option<usize> {
        self.tool_cores.first().copied()
    }

    /// Number of tools.
    pub fn tool_count(&self) -> usize {
        self.tool_cores.len() + usize::from(self.tool_frame.is_some())
    }

    /// Number of rigid bodies among the unknowns: dynamic cores and the tool.
    pub fn rigid_count(&self) -> usize {
        self.cores.len() + usize::from(self.tool_frame.is_some())
    }

    /// Whether any tetrahedron, proxy or chunk has nodes in two frames.
    pub fn spans_frames(&self) -> bool {
        self.links.len() > 1
    }

    /// Largest number of active chunks whose vertices gather contacts.
    pub fn most_gathering(&self) -> usize {
        self.gathering_chunks.min(MAX_WORK_ITEMS)
    }

    /// Largest number of work items (an active chunk in one contact patch each) of chunks whose vertices gather
    /// contacts.
    pub fn max_gathering_work_items(&self) -> usize {
        (PAIR_PATCHES * self.gathering_chunks).min(MAX_WORK_ITEMS)
    }

    /// Largest number of work items (an active chunk in one contact patch each).
    pub fn max_work_items(&self) -> usize {
        (PAIR_PATCHES * self.pair_proxy_chunks).min(MAX_WORK_ITEMS)
    }

    fn add_skin(&mut self, skin: &Skin, vertex_first: usize) {
        let triangle_first = self.triangles.len() as u32;
        let mut fans = vec![Vec::new(); skin.vertices.len()];
        for (t, corners) in skin.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|v| v + vertex_first as u32);
            self.triangles.push([a, b, c, 1f32.to_bits()]);
            corners.iter().for_each(|v| fans[*v as usize].push(triangle_first + t as u32));
        }
        for (fan, area) in fans.iter().zip(&skin.areas) {
            self.fans.extend(fan);
            self.fan_first.push(self.fans.len() as u32);
            self.skin_areas.push(*area as f32);
        }
    }

    /// `node_elements` as the kernels read it: padding becomes the index of a force that is always zero, and the marked
    /// entries of F-bar patches become indices behind that force. This is called once all bodies have been added.
    pub fn padded_node_elements(&self) -> Vec<[u32; 4]> {
        let (nothing, patches) = (4 * self.tetrahedra.len() as u32, self.patches.count() as u32);
        let entry = |e: u32| match e {
            NONE => nothing,
            e if e & OF_PATCH != 0 => {
                let (patch, place) = ((e & !OF_PATCH) / MOST_NODES as u32, (e & !OF_PATCH) % MOST_NODES as u32);
                nothing + 4 + place * patches + patch
            }
            e => e,
        };
        self.node_elements.iter().map(|quad| quad.map(entry)).collect()
    }
}

/// The vec4 of x and w in single precision, as GPU arrays hold it.
pub fn texel(x: DVec3, w: f64) -> [f32; 4] {
    [x.x as f32, x.y as f32, x.z as f32, w as f32]
}
