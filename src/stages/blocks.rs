//! Blocks of nodes, a workgroup each in the solver's passes: free nodes of one frame that lie together, which are also the
//! aggregates of the coarse level, and what dynamic cores carry.

use crate::shaders;
use std::ops::Range;

use faer::{Mat, Side};
use glam::{DMat3, DVec3};

use super::clusters::Graph;
use super::model::{Model, texel};
use crate::shaders::NONE;

/// Free nodes of a block, where nothing but the sharing out of work asks for a number.
const USUAL_NODES: usize = 128;
/// Blocks of a body at most then: every workgroup sums over all of them.
const MOST_BLOCKS: usize = 256;
/// Carried nodes of a block.
const CARRIED_NODES: usize = 256;

/// Moments of a block's shape from which it is not flat, of its size squared.
const LEAST_SPREAD: f64 = 1e-4;

/// What the solver's passes go by.
#[derive(Debug, Clone, Default)]
pub struct Blocks {
    /// First of its nodes, their number, their frame, and the core that carries them or `NONE`; those of free nodes first.
    pub blocks: Vec<[u32; 4]>,
    /// Blocks of free nodes.
    pub free: usize,
    /// The place of a block's modes among those of all: a body's lie together.
    pub slots: Vec<u32>,
    /// Node, its first quad of elements, quads, bits of its damping by mass (kg/s); by block.
    pub nodes: Vec<[u32; 4]>,
    /// Middle of a block's nodes in their frame, m, and 1 over its size, 1/m.
    pub places: Vec<[f32; 4]>,
    /// Inverse of the sum of x x^T over a block's nodes, x their places about its middle over its size: xx yy zz, xy xz yz.
    pub moments: Vec<[f32; 4]>,
    /// Of each core: nodes; blocks.
    pub cores: Vec<(Range<usize>, Range<usize>)>,
}

impl Model {
    /// Shares out the nodes of all bodies; `aggregates`: blocks of free nodes of each soft body, or as usual.
    pub(super) fn add_blocks(&mut self, aggregates: impl Fn(usize) -> Option<usize>) {
        let mut blocks = Blocks::default();
        for (index, soft) in self.soft.iter().enumerate() {
            let free: Vec<u32> =
                soft.nodes.clone().filter(|n| self.node_info[*n][3] == shaders::NODE_FREE).map(|n| n as u32).collect();
            for part in self.parts_of(free, aggregates(index)) {
                blocks.push(self, &part, NONE);
            }
        }
        blocks.free = blocks.blocks.len();
        for (index, core) in self.cores.iter().enumerate() {
            let (node_first, block_first) = (blocks.nodes.len(), blocks.blocks.len());
            for part in core.nodes.chunks(CARRIED_NODES) {
                blocks.push(self, part, index as u32);
            }
            blocks.cores.push((node_first..blocks.nodes.len(), block_first..blocks.blocks.len()));
        }
        // Bodies lie one after another among the nodes.
        let mut order: Vec<usize> = (0..blocks.blocks.len()).collect();
        let body = |b: &usize| self.body_of(blocks.nodes[blocks.blocks[*b][0] as usize][0]);
        order.sort_by_key(body);
        blocks.slots = vec![0; order.len()];
        order.iter().enumerate().for_each(|(slot, b)| blocks.slots[*b] = slot as u32);
        self.blocks = blocks;
    }

    /// Shares out nodes as a model does that differs in materials alone.
    pub(super) fn add_blocks_of(&mut self, before: &Model) {
        self.blocks = before.blocks.clone();
        for node in &mut self.blocks.nodes {
            node[3] = self.node_damping[node[0] as usize].to_bits();
        }
    }

    /// The soft body of a node; those of rigid bodies come after all of these.
    pub(super) fn body_of(&self, node: u32) -> usize {
        let own = self.soft.iter().position(|soft| soft.nodes.contains(&(node as usize)));
        own.unwrap_or(self.soft.len())
    }

    /// Parts of one frame's nodes: so many that lie together each, or, without a number, in the order of the arrays.
    fn parts_of(&self, nodes: Vec<u32>, aggregates: Option<usize>) -> Vec<Vec<u32>> {
        let total = nodes.len().max(1);
        let usual = USUAL_NODES.max(nodes.len().div_ceil(MOST_BLOCKS));
        let mut by_frame: Vec<Vec<u32>> = vec![Vec::new(); self.frames.len()];
        nodes.iter().for_each(|n| by_frame[self.node_info[*n as usize][2] as usize].push(*n));
        let mut parts = Vec::new();
        for own in by_frame.into_iter().filter(|own| !own.is_empty()) {
            match aggregates {
                Some(count) => {
                    let share = ((count * own.len() + total / 2) / total).max(1);
                    let mut clusters = vec![Vec::new(); share];
                    self.graph(&own).clusters(share).iter().zip(&own).for_each(|(k, n)| clusters[*k].push(*n));
                    parts.extend(clusters.into_iter().filter(|part| !part.is_empty()));
                }
                None => parts.extend(own.chunks(usual).map(<[u32]>::to_vec)),
            }
        }
        parts
    }

    /// What some nodes of a frame are to each other; the cube root of a node's mass stands for the edges there.
    fn graph(&self, nodes: &[u32]) -> Graph {
        let places = nodes.iter().map(|n| self.place_in_frame(*n)).collect();
        let sizes = nodes.iter().map(|n| f64::from(self.node_rest[*n as usize][3]).cbrt()).collect();
        let mut index = vec![NONE; self.node_rest.len()];
        nodes.iter().enumerate().for_each(|(k, n)| index[*n as usize] = k as u32);
        let own = |t: &[u32; 4]| t.map(|n| index[n as usize]).into_iter().filter(|k| *k != NONE).collect();
        Graph::new(places, sizes, self.tetrahedra.iter().map(own))
    }

    /// Rest place of a node in its frame, m.
    pub(super) fn place_in_frame(&self, node: u32) -> DVec3 {
        let [x, y, z, _] = self.node_rest[node as usize].map(f64::from);
        DVec3::new(x, y, z)
    }
}

impl Blocks {
    fn push(&mut self, model: &Model, nodes: &[u32], rigid: u32) {
        let Some(first) = nodes.first() else { return };
        let frame = model.node_info[*first as usize][2];
        self.blocks.push([self.nodes.len() as u32, nodes.len() as u32, frame, rigid]);
        let places = || nodes.iter().map(|n| model.place_in_frame(*n));
        let middle = places().sum::<DVec3>() / nodes.len() as f64;
        let size = places().map(|x| x.distance(middle)).fold(0.0, f64::max);
        let inverse_size = if size > 0.0 { 1.0 / size } else { 0.0 };
        self.places.push(texel(middle, inverse_size));
        let square = |x: DVec3| DMat3::from_cols(x * x.x, x * x.y, x * x.z);
        let sum = places().fold(DMat3::ZERO, |sum, x| sum + square((x - middle) * inverse_size));
        // Where nodes lie in a plane or a row nothing is known across, and the fit leaves it as at rest.
        let inverse = inverse_within(sum, LEAST_SPREAD * nodes.len() as f64);
        self.moments.push(texel(DVec3::new(inverse.x_axis.x, inverse.y_axis.y, inverse.z_axis.z), 0.0));
        self.moments.push(texel(DVec3::new(inverse.y_axis.x, inverse.z_axis.x, inverse.z_axis.y), 0.0));
        let info = |n: &u32| model.node_info[*n as usize];
        let damping = |n: &u32| model.node_damping[*n as usize].to_bits();
        self.nodes.extend(nodes.iter().map(|n| [*n, info(n)[0], info(n)[1], damping(n)]));
    }
}

/// The inverse of a symmetric matrix along those of its axes where it exceeds `least`, and nothing along the others.
fn inverse_within(matrix: DMat3, least: f64) -> DMat3 {
    let wide = Mat::from_fn(3, 3, |i, j| matrix.col(j)[i]);
    let Ok(eigen) = wide.self_adjoint_eigen(Side::Lower) else { return DMat3::ZERO };
    let (values, vectors) = (eigen.S(), eigen.U());
    (0..3).filter(|k| values[*k] > least).fold(DMat3::ZERO, |sum, k| {
        let axis = DVec3::new(vectors[(0, k)], vectors[(1, k)], vectors[(2, k)]);
        sum + DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * (1.0 / values[k])
    })
}
