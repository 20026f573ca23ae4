//! Loads on bodies, in the elastic stage of a step: forces on nodes, tractions and pressures on the skin (surface mesh),
//! forces and torques on dynamic cores (rigid parts that forces move). Two passes make of them an external force on each
//! node and core, which the solver adds to its right-hand side. A target is a node, the force on a core, or the torque on
//! a core; a source is a vector or pressure that the host writes for each step.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;

use super::elastic::Elastic;
use super::model::Model;
use super::{Common, count, upload, upload_or_nothing, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::prepare::loads::Part;
use crate::prepare::{Body, Shape};
use crate::scene::{Load, LoadKind};
use crate::shaders;

/// The loads of a scene, as arrays for the kernels; all are empty without loads.
#[derive(Debug, Clone, Default)]
pub struct Loads {
    /// What the host writes for each step.
    pub sources: Vec<Source>,
    /// Loaded triangles: their source.
    triangles: Vec<u32>,
    /// Three per loaded triangle: the nodes that its corner follows.
    corner_nodes: Vec<[u32; 4]>,
    /// Three per loaded triangle: the weights of these nodes.
    corner_weights: Vec<[f32; 4]>,
    /// By target: what acts on it, each as the index of a source, or of a triangle behind the sources, and a factor.
    by_target: BTreeMap<Target, Vec<(u32, f64)>>,
}

/// What a load acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Target {
    Node(usize),
    /// The force on the dynamic core with this frame.
    Force(usize),
    /// The torque on the dynamic core with this frame.
    Torque(usize),
}

/// What the host writes for a load in each step, times the load's factor.
#[derive(Debug, Clone)]
pub struct Source {
    /// The load, which has the factor.
    pub load: Load,
    /// A force, N, a force per area, Pa, or a torque, N m; world axes.
    pub vector: DVec3,
    /// Pressure, Pa.
    pub pressure: f64,
}

impl Model {
    /// Adds the loads of a body whose nodes and frames were added already, from `node_first` and `frame_first` on.
    pub(super) fn add_loads(&mut self, body: &Body, node_first: usize, frame_first: usize) {
        for load in &body.loads {
            let mut source = |vector: DVec3, pressure: f64| {
                self.loads.sources.push(Source { load: load.source.clone(), vector, pressure });
                self.loads.sources.len() as u32 - 1
            };
            match (&load.source.kind, &load.part) {
                (LoadKind::Force { force, .. }, Part::Nodes(nodes)) => {
                    let index = source(*force, 0.0);
                    for node in nodes {
                        self.loads.add(Target::Node(node_first + *node as usize), index, 1.0 / nodes.len() as f64);
                    }
                }
                (LoadKind::Traction { traction, .. }, Part::Triangles(triangles)) => {
                    let index = source(*traction, 0.0);
                    for (node, area) in areas(body, triangles) {
                        self.loads.add(Target::Node(node_first + node as usize), index, area);
                    }
                }
                (LoadKind::Pressure { pressure, .. }, Part::Triangles(triangles)) => {
                    let index = source(DVec3::ZERO, *pressure);
                    triangles.iter().for_each(|triangle| self.loads.add_triangle(body, *triangle, node_first, index));
                }
                (LoadKind::Core { force, torque, .. }, Part::Core(core)) => {
                    let frame = frame_first + core;
                    let parts = [(*force, Target::Force(frame)), (*torque, Target::Torque(frame))];
                    for (vector, target) in parts.into_iter().filter(|(vector, _)| *vector != DVec3::ZERO) {
                        self.loads.sources.push(Source { load: load.source.clone(), vector, pressure: 0.0 });
                        self.loads.add(target, self.loads.sources.len() as u32 - 1, 1.0);
                    }
                }
                // Preparation pairs each kind of load with what it acts on.
                _ => {}
            }
        }
    }

    /// Index of a target in the array of external forces: the nodes, then force and torque of each dynamic core.
    fn external_index(&self, target: Target) -> Option<u32> {
        let of_core = |frame: usize| {
            let core = self.cores.iter().position(|core| core.frame == frame)?;
            Some(self.node_rest.len() + 2 * core)
        };
        let index = match target {
            Target::Node(node) => node,
            Target::Force(frame) => of_core(frame)?,
            Target::Torque(frame) => of_core(frame)? + 1,
        };
        Some(index as u32)
    }
}

impl Loads {
    fn add(&mut self, target: Target, index: u32, factor: f64) {
        self.by_target.entry(target).or_default().push((index, factor));
    }

    /// Adds a triangle under pressure: its force acts on the nodes that its corners follow. Indices of triangles are marked
    /// until the number of all sources is known.
    fn add_triangle(&mut self, body: &Body, triangle: u32, node_first: usize, source: u32) {
        let index = OF_TRIANGLE | self.triangles.len() as u32;
        self.triangles.push(source);
        let mut shares: BTreeMap<u32, f64> = BTreeMap::new();
        for (nodes, weights) in corners(body, triangle) {
            nodes.iter().zip(weights).for_each(|(node, weight)| *shares.entry(*node).or_default() += weight / 3.0);
            self.corner_nodes.push(nodes.map(|node| node + node_first as u32));
            self.corner_weights.push(weights.map(|weight| weight as f32));
        }
        for (node, share) in shares.into_iter().filter(|(_, share)| *share != 0.0) {
            self.add(Target::Node(node_first + node as usize), index, share);
        }
    }
}

/// Marks the index of a triangle.
const OF_TRIANGLE: u32 = 1 << 31;

/// The nodes and the weights that the corners of a soft body's skin triangle follow.
fn corners(body: &Body, triangle: u32) -> Vec<([u32; 4], [f64; 4])> {
    let Shape::Soft { layer, embedding, skin, .. } = &body.shape else { return Vec::new() };
    let corner = |vertex: &u32| {
        let e = &embedding[*vertex as usize];
        (layer.tetrahedra[e.tetrahedron as usize], e.weights)
    };
    skin.triangles[triangle as usize].iter().map(corner).collect()
}

/// The area at rest, m^2, of skin triangles that counts for each node.
fn areas(body: &Body, triangles: &[u32]) -> BTreeMap<u32, f64> {
    let mut areas = BTreeMap::new();
    let Shape::Soft { skin, .. } = &body.shape else { return areas };
    for triangle in triangles {
        let [a, b, c] = skin.triangles[*triangle as usize].map(|v| skin.vertices[v as usize]);
        let third = 0.5 * (b - a).cross(c - a).length() / 3.0;
        for (nodes, weights) in corners(body, *triangle) {
            nodes.iter().zip(weights).for_each(|(node, weight)| *areas.entry(*node).or_default() += third * weight);
        }
    }
    areas
}

/// The kernels and arrays of loads.
pub struct LoadArrays {
    loads: Kernel,
    /// Present where pressures act.
    pressures: Option<Kernel>,
    target_count: u32,
    triangle_count: u32,
    /// One vector per source, written by the host for each step: xyz the vector, w the pressure.
    pub sources: Buffer,
    triangles: Buffer,
    corner_nodes: Buffer,
    corner_weights: Buffer,
    triangle_forces: Buffer,
    targets: Buffer,
    entries: Buffer,
    /// External force of each node, then force and torque of each dynamic core, N and N m.
    pub(super) external_forces: Buffer,
}

impl LoadArrays {
    /// The arrays for a model; `None` without loads.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<LoadArrays>> {
        let loads = &model.loads;
        if loads.sources.is_empty() {
            return Ok(None);
        }
        let sources = loads.sources.len();
        let (mut targets, mut entries) = (Vec::new(), Vec::new());
        for (target, own) in &loads.by_target {
            let Some(index) = model.external_index(*target) else { continue };
            targets.push([index, entries.len() as u32, own.len() as u32]);
            for (index, factor) in own {
                let index = if index & OF_TRIANGLE != 0 { (index & !OF_TRIANGLE) + sources as u32 } else { *index };
                entries.push([index, (*factor as f32).to_bits()]);
            }
        }
        let triangles = loads.triangles.len();
        let sources_c = ("SOURCES", Const::Uint(sources as u32));
        let pressures =
            || Kernel::new(context, "elastic/pressures", Size::Group, &[("TRIANGLES", Const::Uint(triangles as u32))]);
        Ok(Some(LoadArrays {
            loads: Kernel::new(context, "elastic/loads", Size::Group, &[("TARGETS", count(targets.len())), sources_c])?,
            pressures: (triangles > 0).then(pressures).transpose()?,
            target_count: targets.len() as u32,
            triangle_count: triangles as u32,
            sources: Buffer::new(context, "load_sources", 16 * sources as u64, Memory::Upload)?,
            triangles: upload_or_nothing(context, "loaded_triangles", &loads.triangles)?,
            corner_nodes: upload_or_nothing(context, "corner_nodes", &loads.corner_nodes)?,
            corner_weights: upload_or_nothing(context, "corner_weights", &loads.corner_weights)?,
            triangle_forces: zeros::<[f32; 4]>(context, "triangle_forces", triangles)?,
            targets: upload(context, "load_targets", &targets)?,
            entries: upload(context, "load_entries", &entries)?,
            external_forces: zeros::<[f32; 4]>(
                context,
                "external_forces",
                model.node_rest.len() + 2 * model.cores.len(),
            )?,
        }))
    }

    /// Writes the sources for a step that ends at `time`, s.
    pub fn write(&self, model: &Model, time: f64) -> Result<()> {
        let mut sources = self.sources.mapped_mut::<[f32; 4]>()?;
        for (k, source) in model.loads.sources.iter().enumerate() {
            let factor = source.load.factor(time);
            sources[k] = super::model::texel(factor * source.vector, factor * source.pressure);
        }
        Ok(())
    }

    /// Records the copy of what the host wrote, where kernels cannot read it in place, and the passes.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("elastic");
        if self.sources.memory() != Memory::Upload {
            recorder.upload(&self.sources);
        }
        if let Some(pressures) = &self.pressures {
            recorder.dispatch(
                pressures,
                &shaders::elastic::Pressures {
                    frames: &common.frames,
                    node_info: &elastic.node_info,
                    node_rest: &elastic.node_rest,
                    displacement: &elastic.displacement,
                    load_sources: &self.sources,
                    loaded_triangles: &self.triangles,
                    corner_nodes: &self.corner_nodes,
                    corner_weights: &self.corner_weights,
                    triangle_forces: &self.triangle_forces,
                },
                self.triangle_count,
            );
        }
        recorder.dispatch(
            &self.loads,
            &shaders::elastic::Loads {
                load_sources: &self.sources,
                triangle_forces: &self.triangle_forces,
                load_targets: &self.targets,
                load_entries: &self.entries,
                external_forces: &self.external_forces,
            },
            self.target_count,
        );
    }
}
