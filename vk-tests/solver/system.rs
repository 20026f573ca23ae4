//! Inputs of the solver's kernels, and the f64 oracle (the reference implementation on the CPU) in the same state:
//! layers (tetrahedral meshes of soft bodies) in a deformed state, contacts, and a tool (the rigid body that the haptic
//! device leads). A core is a rigid body inside a soft one; a frame is a rigid coordinate frame; an entry is a node
//! with its weight in a contact.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use palpate::Scene;
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::supports::{Freedom, Holder};
use palpate::internal::prepare::{self, Body, FrameMotion, Layer, Materials, Shape, Skin};
use palpate::internal::shaders::{Contact, Counts, Frame, GRADIENT_TEXELS, Link, NONE, StepParams};
use palpate::internal::stages::model::Model;
use palpate::scene::{self, Coupling, Hinge, Material, MaterialLaw, Preconditioner};
use palpate_oracle::contact::{Carrier, Contact as Twin, Point, Tested};
use palpate_oracle::contact_law::Friction;
use palpate_oracle::linear::Entries;
use palpate_oracle::step::{Simulation, SoftBody};
use palpate_oracle::tool::{Device, Tool};

use crate::harness::random::Random;
use crate::stage::elastic;

/// Time step, s: a power of two, so that it is the same in f32 and f64; long, so that stiffness outweighs mass.
pub const DT: f32 = 1.0 / 128.0;

/// Inputs of the solver's kernels, and the oracle's simulation in the same state.
pub struct System {
    pub model: Model,
    pub params: StepParams,
    pub frames: Vec<Frame>,
    pub links: Vec<Link>,
    pub node_elements: Vec<[u32; 4]>,
    pub displacement: Vec<[f32; 4]>,
    pub velocity: Vec<[f32; 4]>,
    /// Change of velocity at which a further Newton iteration linearises elasticity; empty in the first Newton
    /// iteration.
    pub trial_change: Vec<[f32; 4]>,
    /// Rotations, gradients and element forces (this field and the next two) as elastic/element_forces leaves them.
    /// Gradients and forces end with zeros, to which the padding of `node_elements` refers.
    pub rotations: Vec<[f32; 4]>,
    pub gradients: Vec<[f32; 4]>,
    pub element_forces: Vec<[f32; 4]>,
    pub counts: Counts,
    pub contacts: Vec<Contact>,
    pub entry_nodes: Vec<[u32; 4]>,
    pub entry_weights: Vec<[f32; 4]>,
    pub node_entries: Vec<[u32; 2]>,
    pub sorted: Vec<[u32; 2]>,
    pub twin: Simulation,
    pub twin_contacts: Vec<Twin>,
    pub device: Option<Device>,
}

/// A scene of which only the time step `dt` (s) and the preconditioner matter to a layer.
fn scene(dt: f32, preconditioner: Preconditioner) -> Scene {
    Scene {
        file: "none".into(),
        step: scene::Step { dt: f64::from(dt), gravity: DVec3::ZERO, newton: 1 },
        solver: scene::Solver {
            tolerance: Some(1e-5),
            max_iterations: 10,
            preconditioner,
            operator: scene::Operator::Auto,
        },
        contact: scene::Contact {
            stiffness: Some(1e6),
            damping: Some(1e3),
            friction: 0.0,
            friction_speed: 1e-3,
            texel: None,
            sides: scene::Sides::Both,
            samples: scene::Samples::Vertices,
            depth_limit: 0.02,
            depth: None,
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

/// A rigid coordinate frame at rest in the middle of a layer.
pub fn middle(layer: &Layer) -> prepare::Frame {
    let low = layer.nodes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = layer.nodes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    prepare::Frame { centre: 0.5 * (low + high), motion: FrameMotion::Fixed }
}

/// A soft body that has a layer but no skin (surface mesh).
pub fn layered(layer: Layer, material: impl Into<Materials>, orientation: DQuat) -> Body {
    let (skin, proxies) = (Skin::default(), vec![]);
    let (frames, node_frames) = (vec![middle(&layer)], vec![0; layer.nodes.len()]);
    let materials = material.into();
    let supports = Default::default();
    let shape = Shape::Soft {
        layer,
        frames,
        node_frames,
        supports,
        joints: vec![],
        materials,
        embedding: vec![],
        skin,
        proxies,
    };
    Body {
        name: "layer".into(),
        shape,
        position: DVec3::new(0.3, -0.1, 0.2),
        orientation,
        velocity: DVec3::ZERO,
        loads: vec![],
        report: Default::default(),
    }
}

/// The first `nodes` nodes of a box of 20 mm cells, and the tetrahedra among them. A node of no tetrahedron counts as
/// attached, as in the engine.
pub fn layer(nodes: usize) -> Layer {
    let side = (1..).find(|side| (side + 1usize).pow(3) >= nodes).unwrap_or(1);
    let half = DVec3::splat(0.01 * side as f64);
    let mut layer = kuhn_box(-half, half, [side as u32; 3]);
    layer.nodes.truncate(nodes);
    layer.tetrahedra.retain(|t| t.iter().all(|i| (*i as usize) < nodes));
    layer.attached = vec![true; nodes];
    layer.tetrahedra.iter().flatten().for_each(|i| layer.attached[*i as usize] = false);
    layer
}

/// A soft material with damping.
pub fn material(young: f64) -> Material {
    let law = MaterialLaw::Corotational;
    Material { law, young, poisson: 0.45, density: 1e3, damping_mass: 0.5, damping_stiffness: 2e-3 }
}

/// Three materials, of both material laws (corotational and neo-Hookean), each with its own stiffness, density and
/// damping. They are assigned in turn to `tetrahedra` tetrahedra.
pub fn mixed(tetrahedra: usize) -> Materials {
    let soft = material(2e4);
    let dense = Material { law: MaterialLaw::NeoHookean, density: 1.5e3, damping_mass: 3.0, ..material(4e4) };
    let light = Material { law: MaterialLaw::NeoHookean, poisson: 0.0, damping_stiffness: 5e-4, ..material(1e4) };
    Materials { all: vec![soft, dense, light], which: (0..tetrahedra as u32).map(|t| t % 3).collect() }
}

fn narrow(x: DVec3) -> [f32; 4] {
    [x.x as f32, x.y as f32, x.z as f32, 0.0]
}

fn wide(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn generic_tool() -> Tool {
    let coupling = Coupling { stiffness: 500.0, damping: 2.0, angular_stiffness: 0.5, angular_damping: 1e-3 };
    Tool {
        mass: 0.3,
        inertia: DMat3::from_diagonal(DVec3::new(2e-4, 3e-4, 4e-4)),
        centre: DVec3::new(0.02, 0.03, -0.01),
        orientation: DQuat::from_scaled_axis(DVec3::new(0.3, -0.7, 0.4)),
        velocity: DVec3::new(0.1, -0.2, 0.05),
        angular_velocity: DVec3::new(1.0, 0.5, -2.0),
        coupling: Some(coupling),
    }
}

impl System {
    /// Layers whose nodes are displaced at random by up to `amplitude` (m), with velocities of up to 0.1 m/s. The
    /// tetrahedra's rotations, gradients and forces come from elastic/element_forces, and the oracle is given the same
    /// rotations.
    pub fn new(bodies: &[Body], amplitude: f64, seed: u64) -> System {
        System::preconditioned(bodies, amplitude, seed, Preconditioner::Jacobi)
    }

    /// A system like that of [`System::new`], with a coarse space for the bodies to which `preconditioner` gives one.
    pub fn preconditioned(bodies: &[Body], amplitude: f64, seed: u64, preconditioner: Preconditioner) -> System {
        System::stepping(bodies, DT, amplitude, seed, preconditioner)
    }

    /// A system like that of [`System::preconditioned`], with steps of `dt` seconds and bodies at rest.
    pub fn at_rest(bodies: &[Body], dt: f32, preconditioner: Preconditioner) -> System {
        let mut system = System::stepping(bodies, dt, 0.0, 1, preconditioner);
        system.velocity.fill([0.0; 4]);
        system.twin.bodies.iter_mut().for_each(|body| body.velocity.fill(DVec3::ZERO));
        system.rotate();
        system
    }

    fn stepping(bodies: &[Body], dt: f32, amplitude: f64, seed: u64, preconditioner: Preconditioner) -> System {
        let mut random = Random(seed);
        let model = Model::new(&scene(dt, preconditioner), bodies, None);
        let nodes = model.node_rest.len();
        let field = |scale: f64, random: &mut Random| -> Vec<[f32; 4]> {
            let free = |info: &[u32; 4]| if info[3] == 0 { 1.0 } else { 0.0 };
            model.node_info.iter().map(|info| narrow(scale * free(info) * random.vector())).collect()
        };
        let (mut displacement, mut velocity) = (field(amplitude, &mut random), field(0.1, &mut random));
        for (body, range) in bodies.iter().zip(&model.soft) {
            let Shape::Soft { supports, .. } = &body.shape else { continue };
            let turn = DMat3::from_quat(body.orientation);
            for (n, freedom) in range.nodes.clone().zip(&supports.freedom) {
                let left = freedom.projection();
                displacement[n] = narrow(left * wide(&displacement[n]));
                velocity[n] = narrow(turn * left * turn.transpose() * wide(&velocity[n]));
            }
        }
        let gravity = DVec3::new(1.5, -9.75, 0.5);
        let mut twin = Simulation::new(f64::from(dt), gravity);
        for (body, range) in bodies.iter().zip(&model.soft) {
            let Shape::Soft { layer, materials, supports, .. } = &body.shape else {
                panic!("body {} is not soft", body.name)
            };
            let soft = SoftBody::new(layer.clone(), materials, body.position, body.orientation, DVec3::ZERO);
            let mut soft = soft.supported(supports);
            let own = range.nodes.clone();
            soft.displacement = displacement[own.clone()].iter().map(wide).collect();
            soft.velocity = velocity[own].iter().map(wide).collect();
            twin.bodies.push(soft);
        }
        let frame = |place: &palpate::internal::stages::model::FramePlace| Frame {
            rotation: place.orientation.as_quat().to_array(),
            core: NONE,
            ..Frame::default()
        };
        let mut params: StepParams = bytemuck::Zeroable::zeroed();
        params.dt = dt;
        params.gravity = gravity.as_vec3().to_array();
        params.max_iterations = 1000;
        let mut system = System {
            frames: model.frames.iter().map(frame).collect(),
            links: vec![Link { turn: [0.0, 0.0, 0.0, 1.0], ..Link::default() }; model.links.len()],
            node_elements: model.padded_node_elements(),
            rotations: vec![[0.0, 0.0, 0.0, 1.0]; model.tetrahedra.len()],
            gradients: vec![],
            element_forces: vec![],
            trial_change: vec![],
            counts: Counts::default(),
            contacts: vec![],
            entry_nodes: vec![],
            entry_weights: vec![],
            node_entries: vec![[0; 2]; nodes],
            sorted: vec![],
            twin_contacts: vec![],
            device: None,
            model,
            params,
            displacement,
            velocity,
            twin,
        };
        system.start_cores();
        system.rotate();
        system
    }

    /// Sets dynamic cores (whose motion the solver finds) in motion: gives them twists, and the nodes attached to them
    /// the velocities that follow.
    fn start_cores(&mut self) {
        for (index, core) in self.model.cores.iter().enumerate() {
            let place = self.model.frames[core.frame].clone();
            let centre = place.position + place.orientation * place.rest_centre;
            let hinge = (core.hinge != DVec3::ZERO).then_some(core.hinge);
            let (velocity, spin) = match hinge {
                Some(axis) => (DVec3::ZERO, 1.5 * axis),
                None => (DVec3::new(0.05, -0.1, 0.2), DVec3::new(1.5, -0.5, 2.0)),
            };
            let frame = &mut self.frames[core.frame];
            (frame.core, frame.centre) = (index as u32, centre.as_vec3().to_array());
            (frame.linear, frame.angular) = (velocity.as_vec3().to_array(), spin.as_vec3().to_array());
            let turn = DMat3::from_quat(place.orientation);
            let inertia = turn * self.model.inertia_of(core) * turn.transpose();
            frame.gyroscopic = palpate_oracle::tool::gyroscopic(inertia, spin, self.twin.dt).as_vec3().to_array();
            let body = self.model.soft.iter().position(|soft| soft.nodes.contains(&(core.nodes[0] as usize))).unwrap();
            let node_first = self.model.soft[body].nodes.start;
            for node in &core.nodes {
                let arm = place.orientation * wide(&self.model.node_rest[*node as usize]);
                let local = *node as usize - node_first;
                self.twin.bodies[body].velocity[local] = velocity + spin.cross(arm);
                self.velocity[*node as usize] = narrow(velocity + spin.cross(arm));
            }
            let local = core.nodes.iter().map(|n| (body, n - node_first as u32)).collect();
            self.twin.cores.push(palpate_oracle::step::Core { nodes: local, centre, velocity, spin, hinge });
        }
    }

    /// Runs elastic/element_forces and gives the oracle the rotations that it found.
    pub fn rotate(&mut self) {
        let outcome = elastic::rotate(self, &[]);
        self.rotations = outcome.get("rotations");
        self.gradients = outcome.get("gradients");
        self.gradients.extend([[0.0; 4]; GRADIENT_TEXELS as usize]);
        self.element_forces = outcome.get("element_forces");
        self.element_forces.extend([[0.0; 4]; 4]);
        let mut rotations = self.rotations.iter().map(|q| DQuat::from_array(q.map(f64::from)).normalize());
        for body in &mut self.twin.bodies {
            body.given_rotations = Some(rotations.by_ref().take(body.layer.tetrahedra.len()).collect());
        }
    }

    /// The trial change of velocity as elastic/element_forces reads it: a single zero vector if there is no trial
    /// change.
    pub fn trial(&self) -> &[[f32; 4]] {
        if self.trial_change.is_empty() { &[[0.0; 4]] } else { &self.trial_change }
    }

    /// The trial change of velocity of a body's nodes; `None` in the first Newton iteration.
    pub fn trial_change_of(&self, body: usize) -> Option<Vec<DVec3>> {
        let own = self.model.soft.get(body).map_or(0..0, |soft| soft.nodes.clone());
        self.trial_change.get(own).filter(|change| !change.is_empty()).map(|change| change.iter().map(wide).collect())
    }

    /// Lets the solver stop at this relative residual.
    pub fn stop_at(&mut self, tolerance: f32) {
        (self.params.tolerance, self.params.loosest) = (tolerance, tolerance);
    }

    /// Adds a tool that a virtual coupling (spring and damper) pulls towards a pose of the haptic device.
    pub fn with_tool(mut self) -> System {
        let tool = generic_tool();
        let device = Device {
            position: tool.centre + DVec3::new(0.01, 0.0, -0.02),
            orientation: tool.orientation,
            velocity: DVec3::X,
            angular_velocity: DVec3::Y,
        };
        let (mut a, mut b) = (Entries::default(), vec![0.0; 6]);
        tool.add_terms(&mut a, &mut b, 0, self.twin.dt, self.twin.gravity, Some(&device));
        for column in 0..6 {
            let unit: Vec<f64> = (0..6).map(|k| f64::from(u8::from(k == column))).collect();
            for (row, value) in a.multiply(&unit).iter().enumerate() {
                self.params.tool_matrix[6 * row + column] = *value as f32;
            }
        }
        self.params.tool_rhs = std::array::from_fn(|k| b[k] as f32);
        let twist: Vec<f64> = [tool.velocity.to_array(), tool.angular_velocity.to_array()].concat();
        self.params.tool_twist = std::array::from_fn(|k| twist[k] as f32);
        self.params.tool_centre = tool.centre.as_vec3().to_array();
        self.twin.tool = Some(tool);
        self.device = Some(device);
        self
    }

    /// Contacts that are added after this call have friction as well.
    pub fn with_friction(mut self) -> System {
        self.twin.friction = Some(Friction { coefficient: 0.7, speed: 0.01 });
        self
    }

    /// Adds contacts of every kind: each side of a contact is one skin vertex of a layer, the three vertices of an
    /// opposing triangle (whose tetrahedra share nodes), the tool, or something that does not move. Every eleventh
    /// contact is released: it has no stiffness and no damping, like a contact that would pull.
    pub fn with_contacts(mut self, count: usize, seed: u64) -> System {
        let mut random = Random(seed);
        let (near, far) = (0, self.twin.bodies.len() - 1);
        let tool = || if self.twin.tool.is_some() { Side::Tool } else { Side::Fixed };
        let kinds = [
            [Side::Soft(near, 1), Side::Fixed],
            [Side::Soft(near, 1), Side::Soft(far, 3)],
            [Side::Soft(near, 1), tool()],
            [Side::Soft(far, 3), tool()],
            [tool(), Side::Fixed],
            [tool(), Side::Soft(far, 1)],
            [Side::Soft(near, 3), Side::Soft(far, 1)],
        ];
        for c in 0..count {
            self.add_contact(kinds[c % kinds.len()], c % 11 == 10, &mut random);
        }
        self.counts.contacts = count as u32;
        self.transpose();
        self
    }

    fn add_contact(&mut self, sides: [Side; 2], released: bool, random: &mut Random) {
        let normal = wide(&narrow((random.vector() + DVec3::Y).normalize()));
        let position = 0.1 * random.vector();
        let first_quad = self.entry_nodes.len();
        let [first, second] = [0, 1].map(|k| {
            let sign = if k == 0 { 1.0 } else { -1.0 };
            let carrier = match sides[k] {
                Side::Soft(body, quads) => Carrier::Nodes(body, self.add_entries(body, quads, sign, random)),
                Side::Tool => Carrier::Tool,
                Side::Fixed => Carrier::Fixed,
            };
            Point { position, carrier }
        });
        let quads = (self.entry_nodes.len() - first_quad) as u32;
        self.entry_nodes.resize(first_quad + 4, [NONE; 4]);
        self.entry_weights.resize(first_quad + 4, [f32::NAN; 4]);
        let on = if released { 0.0 } else { 1.0 };
        let positive = |random: &mut Random| f64::from((1.5 + random.next()) as f32);
        let mut twin = Twin {
            normal,
            area: f64::from(1e-4f32) * positive(random),
            depth: f64::from(1e-3f32) * positive(random),
            stiffness: on * 5e6,
            damping: on * 5e3,
            first,
            second,
            of_first: true,
            tested: Tested::Vertex(0),
        };
        twin.first.position += 0.5 * twin.depth * normal;
        twin.second.position -= 0.5 * twin.depth * normal;
        let (start, unknowns) = (self.start(), self.twin.unknowns());
        let row = self.twin.row(&unknowns, &twin);
        let drag = self.twin.drag(&unknowns, &start, &vec![0.0; unknowns.count], &twin);
        // Friction acts on the tool at the contact point of the other side.
        let at = if let Side::Tool = sides[0] { twin.second.position } else { twin.first.position };
        let sign = match sides {
            [Side::Tool, _] => 1.0,
            [_, Side::Tool] => -1.0,
            _ => 0.0,
        };
        let centre = self.twin.tool.as_ref().map_or(DVec3::ZERO, |tool| tool.centre);
        self.contacts.push(Contact {
            normal: normal.as_vec3().to_array(),
            area: twin.area as f32,
            arm: (at - centre).as_vec3().to_array(),
            tool_sign: sign as f32,
            depth: twin.depth as f32,
            rate: row.iter().map(|(i, w)| w * start[*i]).sum::<f64>() as f32,
            stiffness: twin.stiffness as f32,
            damping: twin.damping as f32,
            friction: drag.viscosity as f32,
            slip: drag.slip().as_vec3().to_array(),
            quads,
            ..Contact::default()
        });
        self.twin_contacts.push(twin);
    }

    /// Adds entries for `quads` vertices of the skin (surface mesh), which lie in neighbouring tetrahedra; all weights
    /// sum to `sign`. Returns, for each node, the sum of its weights without that sign.
    fn add_entries(&mut self, body: usize, quads: usize, sign: f64, random: &mut Random) -> Vec<(u32, f64)> {
        let (tetrahedra, first) = (&self.twin.bodies[body].layer.tetrahedra, self.model.soft[body].nodes.start as u32);
        let start = random.below(tetrahedra.len());
        let mut sums = BTreeMap::new();
        for k in 0..quads {
            let nodes = tetrahedra[(start + k) % tetrahedra.len()];
            let mut weights: [f64; 4] = std::array::from_fn(|_| 0.7 + 0.6 * random.next());
            // Some skin vertices lie on a face of their tetrahedron.
            if random.next() > 0.5 {
                weights[k] = 0.0;
            }
            let total: f64 = weights.iter().sum::<f64>() * quads as f64;
            let weights = weights.map(|w| (sign * w / total) as f32);
            nodes.iter().zip(weights).for_each(|(n, w)| *sums.entry(*n).or_insert(0.0) += sign * f64::from(w));
            self.entry_nodes.push(nodes.map(|n| n + first));
            self.entry_weights.push(weights);
        }
        sums.into_iter().collect()
    }

    /// Makes the index from nodes to entries: each node has a run (a range of the array `sorted`) with its entries in
    /// the order of contacts. The runs are not in the order of nodes.
    fn transpose(&mut self) {
        let mut runs = vec![Vec::new(); self.node_entries.len()];
        for (c, contact) in self.contacts.iter().enumerate() {
            for quad in 4 * c..4 * c + contact.quads as usize {
                for (node, weight) in self.entry_nodes[quad].iter().zip(self.entry_weights[quad]) {
                    if weight != 0.0 {
                        runs[*node as usize].push([c as u32, weight.to_bits()]);
                    }
                }
            }
        }
        for (i, run) in runs.iter().enumerate().rev() {
            self.node_entries[i] = [self.sorted.len() as u32, run.len() as u32];
            self.sorted.extend(run);
        }
    }

    /// Velocities at the start of the step, in the order of the oracle's unknowns.
    pub fn start(&self) -> Vec<f64> {
        let twist =
            self.twin.tool.as_ref().map(|tool| [tool.velocity.to_array(), tool.angular_velocity.to_array()].concat());
        let twist = twist.unwrap_or_default();
        self.unknowns(&self.velocity, &std::array::from_fn(|k| twist.get(k).copied().unwrap_or_default() as f32))
    }

    /// Puts values at the nodes, and the tool's six values, into the order of the oracle's unknowns.
    pub fn unknowns(&self, nodes: &[[f32; 4]], tool: &[f32; 6]) -> Vec<f64> {
        let unknowns = self.twin.unknowns();
        let mut all = vec![0.0; unknowns.count];
        for (x, first) in nodes.iter().zip(unknowns.nodes.iter().flatten()) {
            if let [(first, _)] = first[..] {
                all[first..first + 3].copy_from_slice(&wide(x).to_array());
            }
        }
        for (core, first) in self.twin.cores.iter().zip(&unknowns.cores) {
            let twist = [core.velocity, core.spin].map(|x| x.to_array()).concat();
            all[*first..first + 6].copy_from_slice(&twist);
        }
        for (value, x) in all[unknowns.tool..].iter_mut().zip(tool) {
            *value = f64::from(*x);
        }
        all
    }

    /// Converts the oracle's unknowns to three values for each node, body by body, and the tool's six values. At nodes
    /// that are attached to a dynamic core the values are the core's motion; at other attached nodes they are zero.
    pub fn rows(&self, unknowns: &[f64]) -> (Vec<Vec<f64>>, Vec<f64>) {
        let places = self.twin.unknowns();
        let row = |map: &palpate_oracle::step::Map| {
            let part = |(first, matrix): &(usize, DMat3)| *matrix * DVec3::from_slice(&unknowns[*first..first + 3]);
            map.iter().map(part).sum::<DVec3>().to_array()
        };
        let bodies = places.nodes.iter().map(|nodes| nodes.iter().flat_map(row).collect()).collect();
        (bodies, unknowns[places.tool..].to_vec())
    }

    /// Random vectors at the free nodes, zero at all others.
    pub fn random_field(&self, random: &mut Random) -> Vec<[f32; 4]> {
        let free = |info: &[u32; 4]| if info[3] == 0 { 1.0 } else { 0.0 };
        self.model.node_info.iter().map(|info| narrow(free(info) * random.vector())).collect()
    }
}

/// What a contact acts on at one of its two sides.
#[derive(Clone, Copy)]
enum Side {
    /// A soft body: its index, and the number of its skin vertices in the contact.
    Soft(usize, usize),
    Tool,
    Fixed,
}

/// Two layers of different stiffness, each of them turned. The first has 100 nodes; the second has 60 nodes, of which
/// nine are attached.
pub fn two_layers() -> Vec<Body> {
    let mut second = layer(60);
    second.attached[..9].fill(true);
    vec![
        layered(layer(100), material(2e4), DQuat::from_scaled_axis(DVec3::new(0.4, 1.0, -0.3))),
        layered(second, material(2e5), DQuat::from_scaled_axis(DVec3::new(-2.0, 0.3, 0.8))),
    ]
}

/// The bodies of [`two_layers`] with supports: a third of the first body's nodes is left a plane, a line or nothing; two
/// supports share some of these nodes, along directions that are not orthogonal. The forces that hold the attached nodes
/// of the second body are reported.
pub fn two_layers_supported() -> Vec<Body> {
    let mut bodies = two_layers();
    let (plane, other) = (DVec3::new(0.48, 0.6, 0.64), DVec3::new(0.0, 0.6, 0.8));
    for (body, bodys) in bodies.iter_mut().enumerate() {
        let Shape::Soft { layer, supports, .. } = &mut bodys.shape else { continue };
        let count = layer.nodes.len();
        supports.freedom = vec![Freedom::Free; count];
        let mut holders = vec![Vec::new(); 3];
        for n in 0..count {
            let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
            match (body, layer.attached[n], n % 12) {
                (1, true, _) => {
                    supports.freedom[n] = Freedom::Held;
                    holders[0].push((n as u32, DMat3::IDENTITY));
                }
                (0, false, 1 | 7) => {
                    supports.freedom[n] = Freedom::Plane(plane);
                    holders[0].push((n as u32, outer(plane, plane)));
                }
                (0, false, 4) => {
                    supports.freedom[n] = Freedom::Axis(plane.cross(other).normalize());
                    // The force is f = c1 n1 + c2 n2, and the share of a support c1 n1: the dual of n1 gives c1.
                    let duals = DMat3::from_cols(plane, other, plane.cross(other)).inverse().transpose();
                    holders[0].push((n as u32, outer(plane, duals.x_axis)));
                    holders[1].push((n as u32, outer(other, duals.y_axis)));
                }
                (0, false, 9) => {
                    supports.freedom[n] = Freedom::Held;
                    holders[2].push((n as u32, DMat3::IDENTITY));
                }
                _ => {}
            }
        }
        let holders = holders.into_iter().enumerate().filter(|(_, nodes)| !nodes.is_empty());
        supports.holders = holders.map(|(k, nodes)| Holder { name: format!("holder{k}"), nodes }).collect();
    }
    bodies
}

/// The first three numbers of each element.
pub fn triples(nodes: &[[f32; 4]]) -> Vec<f32> {
    nodes.iter().flat_map(|x| [x[0], x[1], x[2]]).collect()
}

/// The bodies of [`two_layers`]; the attached nodes of the second are attached to a dynamic rigid core.
pub fn two_layers_one_on_a_core() -> Vec<Body> {
    let mut bodies = two_layers();
    if let Shape::Soft { layer, frames, materials, .. } = &mut bodies[1].shape {
        let masses = palpate_oracle::elastic::Elements::new(layer, &*materials, DMat3::IDENTITY).masses;
        let bound = (0..masses.len()).filter(|n| layer.attached[*n]);
        let (sum, mass) = bound.fold((DVec3::ZERO, 0.0), |(s, m), n| (s + masses[n] * layer.nodes[n], m + masses[n]));
        frames[0] = prepare::Frame { centre: sum / mass, motion: FrameMotion::Dynamic { mass: None, hinge: None } };
    }
    bodies
}

/// The bodies of [`two_layers_one_on_a_core`], with that core on a hinge that does not pass through its centre.
pub fn two_layers_one_on_a_hinge() -> Vec<Body> {
    let mut bodies = two_layers_one_on_a_core();
    if let Shape::Soft { frames, .. } = &mut bodies[1].shape {
        let point = frames[0].centre + DVec3::new(0.02, -0.01, 0.03);
        let hinge = Some(Hinge { point, axis: DVec3::new(0.48, 0.6, 0.64) });
        frames[0] = prepare::Frame { centre: point, motion: FrameMotion::Dynamic { mass: None, hinge } };
    }
    bodies
}
