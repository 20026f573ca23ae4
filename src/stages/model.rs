//! From prepared bodies to the arrays that the kernels read: all bodies one after another, indices made global,
//! positions relative to their frame's centre in f32. Made once; what changes from step to step is not here.

use crate::shaders;
use std::ops::Range;

use glam::{DQuat, DVec3};

use super::blocks::Blocks;
use super::coarse::Coarse;
use super::dilate::Patches;
use super::gap;
use super::joints::Joint;
use super::layers::OF_PATCH;
use crate::prepare::patch::MOST_NODES;
use crate::prepare::{Body, Embedding, FrameMotion, Layer, Shape, Skin};
use crate::scene::{Scene, Sides, ToolShape};
use crate::shaders::{Chunk, ElasticMaterial, NONE, Pair, Proxy, Slot};
use crate::stages::PAIR_REGIONS;

/// Active chunks times their regions at most, a workgroup each on any device: four million vertices; more raise the region
/// overflow flag.
const MOST_ITEMS: usize = (1 << 16) - 1;

/// A frame of a body, as placed.
#[derive(Debug, Clone)]
pub struct FramePlace {
    /// World position of the body's rest frame, m.
    pub position: DVec3,
    /// Rest frame to world.
    pub orientation: DQuat,
    /// The frame's centre in the body's rest frame, m.
    pub rest_centre: DVec3,
    /// How it moves.
    pub motion: Motion,
}

/// How a frame moves.
#[derive(Debug, Clone)]
pub enum Motion {
    /// As prepared.
    Prepared(FrameMotion),
    /// It is the tool's.
    Tool,
}

/// A half-space in world coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// Unit outward normal.
    pub normal: DVec3,
    /// m.
    pub offset: f64,
}

/// Where a soft body's nodes and skin lie in the arrays.
#[derive(Debug, Clone)]
pub struct SoftRange {
    /// Index among the bodies.
    pub body: usize,
    /// Its nodes.
    pub nodes: Range<usize>,
}

/// What the skin of a soft body rides on.
pub(super) struct Carrier<'a> {
    pub layer: &'a Layer,
    pub embedding: &'a [Embedding],
    pub node_first: usize,
}

/// A floating frame, and the nodes that it follows.
#[derive(Debug, Clone)]
pub struct Floating {
    /// Among the frames.
    pub frame: usize,
    /// Among the nodes.
    pub nodes: Range<usize>,
}

/// A dynamic core.
#[derive(Debug, Clone)]
pub struct Core {
    /// Among the frames.
    pub frame: usize,
    /// Nodes it carries.
    pub nodes: Vec<u32>,
    /// Unit axis through its centre that is all it may turn about, world; zero: it moves freely.
    pub hinge: DVec3,
    /// The cores that joints join it to, itself included: they lie together, each after the one it hangs on.
    pub group: Range<usize>,
    /// The one it hangs on.
    pub parent: Option<usize>,
}

/// All static arrays.
#[derive(Debug, Default)]
pub struct Model {
    /// The frames of all bodies.
    pub frames: Vec<FramePlace>,
    /// Coefficient, and the speed below which friction is viscous, m/s.
    pub friction: [f32; 2],
    /// Linearisations of elasticity in a step.
    pub newton: u32,
    /// The materials of all bodies.
    pub materials: Vec<ElasticMaterial>,
    /// First frame of each body; `NONE` for a half-space.
    pub body_frames: Vec<u32>,
    /// Pairs of frames (to, from) that something spans; the first is of a frame with itself.
    pub links: Vec<[u32; 2]>,
    /// Nodes that moving frames carry: driven ones and dynamic cores.
    pub carried_nodes: Vec<u32>,
    /// Dynamic cores.
    pub cores: Vec<Core>,
    /// Joints between frames.
    pub joints: Vec<Joint>,
    /// How nodes are shared out to workgroups.
    pub blocks: Blocks,
    /// The coarse level, of the bodies that have one.
    pub coarse: Coarse,
    /// Floating frames.
    pub floating: Vec<Floating>,
    /// Frame of the tool.
    pub tool_frame: Option<usize>,
    /// Radius of a tool that is a sphere, m.
    pub tool_sphere: Option<f64>,
    /// Of a ball about a rigid tool's centre that holds all of it, m.
    pub tool_radius: f64,
    /// The dynamic core that the device holds, where the tool is a body.
    pub held: Option<usize>,
    /// Soft bodies.
    pub soft: Vec<SoftRange>,

    /// Rest position in the frame, mass.
    pub node_rest: Vec<[f32; 4]>,
    /// Damping by mass, kg/s: of a node's share of its elements, density times alpha.
    pub node_damping: Vec<f32>,
    /// First quad of elements, quads, frame, and 0 where free, 1 where held, 2 where a dynamic core carries it.
    pub node_info: Vec<[u32; 4]>,
    /// Entries into element forces, four a texel.
    pub node_elements: Vec<[u32; 4]>,
    /// World velocity at the start.
    pub velocity: Vec<[f32; 4]>,
    /// Four nodes.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Links from the frame of a tetrahedron (its first node's) to those of its nodes.
    pub tetrahedron_links: Vec<[u32; 4]>,
    /// Three a tetrahedron, and three zeros: gradients of its last three nodes; w of the first: sqrt(V).
    pub rest_gradients: Vec<[f32; 4]>,
    /// Material and frame of each tetrahedron.
    pub element_info: Vec<[u32; 2]>,

    /// Patches of tetrahedra that share a volumetric strain.
    pub patches: Patches,

    /// Four nodes; `NONE` first on a rigid body.
    pub skin_nodes: Vec<[u32; 4]>,
    /// Four weights, or the position in the frame.
    pub skin_weights: Vec<[f32; 4]>,
    /// Rest area, m^2.
    pub skin_areas: Vec<f32>,
    /// Three skin vertices.
    pub triangles: Vec<[u32; 4]>,
    /// Running totals of the triangles around each vertex.
    pub fan_first: Vec<u32>,
    /// Triangles around each vertex.
    pub fans: Vec<u32>,

    /// Proxies of all bodies.
    pub proxies: Vec<Proxy>,
    /// Hull vertices in the frame.
    pub hull: Vec<[f32; 4]>,
    /// Face planes in the frame.
    pub faces: Vec<[f32; 4]>,
    /// Nodes that move a proxy, by proxy, each with the link from the proxy's frame to its own.
    pub proxy_nodes: Vec<[u32; 2]>,
    /// Chunks of all proxies.
    pub chunks: Vec<Chunk>,
    /// Skin vertices, by chunk, and up to three zeros.
    pub chunk_vertices: Vec<u32>,
    /// Triangles, by chunk, and up to three zeros.
    pub chunk_triangles: Vec<u32>,
    /// Nodes that move a chunk, by chunk, as for proxies.
    pub chunk_nodes: Vec<[u32; 2]>,

    /// Pairs of bodies; planes still zero.
    pub pairs: Vec<Pair>,
    /// The bodies a and b of each pair; the tool comes last.
    pub pair_bodies: Vec<[usize; 2]>,
    /// The half-space of each pair that has one.
    pub pair_planes: Vec<Option<Plane>>,
    /// Proxy of a, proxy of b.
    pub proxy_pairs: Vec<[u32; 4]>,
    /// Proxies of all pairs of bodies.
    pub slots: Vec<Slot>,
    /// Chunks of all slots.
    pub slot_chunks: usize,
    /// Slots whose vertices gather contacts: the first.
    pub gathering_slots: usize,
    /// Their chunks.
    pub gathering_chunks: usize,
}

impl Model {
    /// The arrays of a scene's bodies; the tool, if any, comes last.
    pub fn new(scene: &Scene, bodies: &[Body], tool: Option<&Body>) -> Model {
        Model::made(scene, bodies, tool, None)
    }

    /// The arrays of the same bodies with other materials or another contact law: of the same sizes as these, and with work
    /// shared out and a coarse level as here.
    pub fn again(&self, scene: &Scene, bodies: &[Body], tool: Option<&Body>) -> Model {
        Model::made(scene, bodies, tool, Some(self))
    }

    fn made(scene: &Scene, bodies: &[Body], tool: Option<&Body>, before: Option<&Model>) -> Model {
        let all: Vec<&Body> = bodies.iter().chain(tool).collect();
        let (mut model, proxy_ranges) = Model::of_bodies(&all, bodies.len());
        model.group_cores();
        model.stiffen_joints(scene.step.dt);
        match before {
            Some(before) => model.add_coarse_again(scene.longest_step(), before),
            None => model.add_coarse(scene.longest_step(), scene.solver.preconditioner),
        }
        model.friction = [scene.contact.friction as f32, scene.contact.friction_speed as f32];
        model.newton = scene.step.newton;
        model.tool_sphere = scene.tool.as_ref().and_then(|tool| match tool.shape {
            ToolShape::Sphere(radius) => Some(radius),
            _ => None,
        });
        let held_frame = scene.held_body().map(|body| model.body_frames[body] as usize);
        model.held = model.cores.iter().position(|core| Some(core.frame) == held_frame);
        model.add_pairs(scene, &all, tool.is_some(), &proxy_ranges);
        model.tool_radius = gap::tool_radius(&model);
        model
    }

    /// The arrays of two bodies that are asked where they overlap: one pair, whether they can move or not.
    pub fn of_query(a: &Body, b: &Body) -> Model {
        let all = [a, b];
        let (mut model, proxy_ranges) = Model::of_bodies(&all, all.len());
        // No force comes of it: any law will do.
        model.add_pair(&all, (0, 1), all.len(), &proxy_ranges, [1.0, 0.0], Sides::Both);
        model.add_slots();
        model
    }

    /// The arrays of bodies without their pairs, and the proxies of each.
    fn of_bodies(all: &[&Body], tool: usize) -> (Model, Vec<Range<usize>>) {
        let mut model = Model { links: vec![[0, 0]], fan_first: vec![0], ..Model::default() };
        let mut proxy_ranges = Vec::new();
        for (index, body) in all.iter().enumerate() {
            let first = model.proxies.len();
            model.add_body(index, body, index == tool);
            proxy_ranges.push(first..model.proxies.len());
        }
        // Read four at a time.
        model.chunk_vertices.resize(model.chunk_vertices.len().next_multiple_of(4), 0);
        model.chunk_triangles.resize(model.chunk_triangles.len().next_multiple_of(4), 0);
        // The entry that pads node lists, and reads as nothing.
        model.rest_gradients.extend([[0.0; 4]; 3]);
        (model, proxy_ranges)
    }

    fn add_body(&mut self, index: usize, body: &Body, is_tool: bool) {
        match &body.shape {
            Shape::Plane { .. } => self.body_frames.push(NONE),
            Shape::Soft { layer, frames, node_frames, joints, materials, embedding, skin, proxies } => {
                let frame_first = self.frames.len();
                self.body_frames.push(frame_first as u32);
                for frame in frames {
                    self.add_frame(body, frame.centre, Motion::Prepared(frame.motion.clone()));
                }
                let node_first = self.node_rest.len();
                self.add_layer(layer, node_frames, materials, frame_first, body.velocity);
                self.add_joints(joints, frame_first);
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
                self.add_skin(skin, vertex_first);
                self.add_proxies(skin, proxies, frame, vertex_first, None);
            }
        }
    }

    fn add_frame(&mut self, body: &Body, rest_centre: DVec3, motion: Motion) {
        let Body { position, orientation, .. } = *body;
        self.frames.push(FramePlace { position, orientation, rest_centre, motion });
    }

    /// The link from frame `to` to frame `from`: where a point that rides on `from` is in `to`.
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

    /// Whether the solver decides the motion of a node.
    pub fn is_free(&self, node: usize) -> bool {
        self.node_info[node][3] == shaders::NODE_FREE
    }

    /// Whether a dynamic core carries a node.
    pub fn is_carried(&self, node: usize) -> bool {
        self.node_info[node][3] == shaders::NODE_CARRIED
    }

    /// Whether anything spans two frames.
    pub fn spans_frames(&self) -> bool {
        self.links.len() > 1
    }

    /// Chunks whose vertices gather contacts, as many as can be active at once.
    pub fn most_gathering(&self) -> usize {
        self.gathering_chunks.min(MOST_ITEMS)
    }

    /// The same, times their regions.
    pub fn most_gathering_items(&self) -> usize {
        (PAIR_REGIONS * self.gathering_chunks).min(MOST_ITEMS)
    }

    /// Chunks times regions that can be active at once.
    pub fn most_items(&self) -> usize {
        (PAIR_REGIONS * self.slot_chunks).min(MOST_ITEMS)
    }

    fn add_skin(&mut self, skin: &Skin, vertex_first: usize) {
        let triangle_first = self.triangles.len() as u32;
        let mut fans = vec![Vec::new(); skin.vertices.len()];
        for (t, corners) in skin.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|v| v + vertex_first as u32);
            self.triangles.push([a, b, c, 0]);
            corners.iter().for_each(|v| fans[*v as usize].push(triangle_first + t as u32));
        }
        for (fan, area) in fans.iter().zip(&skin.areas) {
            self.fans.extend(fan);
            self.fan_first.push(self.fans.len() as u32);
            self.skin_areas.push(*area as f32);
        }
    }

    /// Replaces the padding of node lists by the entry that reads as nothing, and marks by the entries of patches, which stand
    /// behind that; called once all bodies are in.
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

/// A vec4 of the device.
pub fn texel(x: DVec3, w: f64) -> [f32; 4] {
    [x.x as f32, x.y as f32, x.z as f32, w as f32]
}
