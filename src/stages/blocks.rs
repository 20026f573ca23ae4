//! Divides the nodes of all bodies into *blocks*, before the first step: each workgroup of the solver works on one
//! block. A *frame* is a rigid coordinate frame in which nodes move. A block holds either free nodes (nodes attached to
//! no rigid body) that lie together in one frame, or nodes attached to one *dynamic core* (rigid body, moved by
//! forces, inside a soft one). A body may have a *coarse space*, by which the solver preconditions its linear system; then each
//! block of free nodes is an *aggregate* of this space. A *mode* is one of a block's motions in the coarse space: free
//! nodes have twelve affine motions, and nodes attached to a core have six rigid motions (see `coarse.rs`).

use std::ops::Range;

use faer::{Mat, Side};
use glam::{DMat3, DVec3};

use super::aggregates::Graph;
use super::model::{Model, texel};
use crate::shaders::NONE;

/// Number of free nodes per block of a body without a coarse space, where blocks only divide the work.
const USUAL_NODES: usize = 128;
/// Largest number of blocks of a body without a coarse space. The number is limited because every workgroup of the
/// kernel `solve/update` sums over all blocks.
const MOST_BLOCKS: usize = 256;
/// Largest number of nodes in a block of attached nodes.
const ATTACHED_NODES: usize = 256;

/// A block counts as flat along a principal axis if the mean square distance of its nodes from their mean, along this
/// axis and as a share of the square of the block's size, is below this. The size of a block is the distance of its
/// farthest node from the mean of its nodes.
const LEAST_SPREAD: f64 = 1e-4;

/// The blocks of all bodies, as arrays for the solver's kernels.
#[derive(Debug, Clone, Default)]
pub struct Blocks {
    /// Per block: index of its first node in `nodes`, number of nodes, frame, and the dynamic core to which its nodes
    /// are attached (`NONE` for free nodes). Blocks of free nodes come first.
    pub blocks: Vec<[u32; 4]>,
    /// Number of blocks of free nodes.
    pub free: usize,
    /// Per block: its place in the coarse vectors, which hold one number for each mode of every block. In these vectors
    /// the blocks of a body are consecutive.
    pub coarse_indices: Vec<u32>,
    /// Per node, block by block: node index; index of the node's first uvec4 in the model's array `node_elements`,
    /// which lists the element forces that act on each node; number of the node's uvec4s there; and the bits of its
    /// mass-proportional damping (f32, kg/s).
    pub nodes: Vec<[u32; 4]>,
    /// Per block: x, y, z are the mean rest position of its nodes in their frame (m); w is 1 over the block's size
    /// (1/m), or 0 for a block of size zero.
    pub places: Vec<[f32; 4]>,
    /// Two vec4 per block: the inverse of the sum of x x^T over the block's nodes, where x is a node's rest position
    /// relative to the mean of the nodes, divided by the block's size. It serves to fit an affine motion to the nodes'
    /// displacements. The first vec4 has the components xx, yy, zz and 0, the second xy, xz, yz and 0.
    pub moments: Vec<[f32; 4]>,
    /// Per dynamic core: the range of its nodes in `nodes`, and the range of its blocks.
    pub cores: Vec<(Range<usize>, Range<usize>)>,
}

impl Model {
    /// Divides the nodes of all bodies into blocks. `aggregates` returns, for the index of a soft body, the number of
    /// blocks into which the body's free nodes are clustered; if it returns `None`, the free nodes are cut into runs of
    /// about [`USUAL_NODES`] nodes in the order of the model's arrays.
    pub(super) fn add_blocks(&mut self, aggregates: impl Fn(usize) -> Option<usize>) {
        let mut blocks = Blocks::default();
        for (index, soft) in self.soft.iter().enumerate() {
            let free: Vec<u32> = soft.nodes.clone().filter(|n| self.has_equation(*n)).map(|n| n as u32).collect();
            for part in self.parts_of(free, aggregates(index)) {
                blocks.push(self, &part, NONE);
            }
        }
        blocks.free = blocks.blocks.len();
        for (index, core) in self.cores.iter().enumerate() {
            let (node_first, block_first) = (blocks.nodes.len(), blocks.blocks.len());
            for part in core.nodes.chunks(ATTACHED_NODES) {
                blocks.push(self, part, index as u32);
            }
            blocks.cores.push((node_first..blocks.nodes.len(), block_first..blocks.blocks.len()));
        }
        // The coarse vectors hold the blocks body by body, whereas `blocks` holds all blocks of free nodes first.
        let mut order: Vec<usize> = (0..blocks.blocks.len()).collect();
        let body = |b: &usize| self.body_of(blocks.nodes[blocks.blocks[*b][0] as usize][0]);
        order.sort_by_key(body);
        blocks.coarse_indices = vec![0; order.len()];
        order.iter().enumerate().for_each(|(coarse_index, b)| blocks.coarse_indices[*b] = coarse_index as u32);
        self.blocks = blocks;
    }

    /// Copies the blocks of `before`, a model that differs from this model in materials alone; only the damping is new.
    pub(super) fn add_blocks_of(&mut self, before: &Model) {
        self.blocks = before.blocks.clone();
        for node in &mut self.blocks.nodes {
            node[3] = self.node_damping[node[0] as usize].to_bits();
        }
    }

    /// Index of the soft body that a node belongs to; for nodes of rigid bodies the number of soft bodies, so that
    /// these nodes are sorted last.
    pub(super) fn body_of(&self, node: u32) -> usize {
        let own = self.soft.iter().position(|soft| soft.nodes.contains(&(node as usize)));
        own.unwrap_or(self.soft.len())
    }

    /// Divides `nodes`, the free nodes of a body, first by frame and then into parts. The parts are clusters of
    /// neighbouring nodes, about `aggregates` clusters for the whole body, or, if `aggregates` is `None`, runs of nodes
    /// in the order of the model's arrays. A part's nodes are sorted by their number of elements, rounded up to fours, so
    /// that lanes next to each other have about equal work.
    fn parts_of(&self, nodes: Vec<u32>, aggregates: Option<usize>) -> Vec<Vec<u32>> {
        let total = nodes.len().max(1);
        let usual = USUAL_NODES.max(nodes.len().div_ceil(MOST_BLOCKS));
        let mut by_frame: Vec<Vec<u32>> = vec![Vec::new(); self.frames.len()];
        nodes.iter().for_each(|n| by_frame[self.node_info[*n as usize][2] as usize].push(*n));
        let mut parts = Vec::new();
        for own in by_frame.into_iter().filter(|own| !own.is_empty()) {
            let first_part = parts.len();
            match aggregates {
                Some(count) => {
                    let share = ((count * own.len() + total / 2) / total).max(1);
                    let mut aggregates = vec![Vec::new(); share];
                    self.graph(&own).aggregates(share).iter().zip(&own).for_each(|(k, n)| aggregates[*k].push(*n));
                    parts.extend(aggregates.into_iter().filter(|part| !part.is_empty()));
                }
                None => parts.extend(own.chunks(usual).map(<[u32]>::to_vec)),
            }
            for part in &mut parts[first_part..] {
                part.sort_by_key(|n| self.node_info[*n as usize][1]);
            }
        }
        parts
    }

    /// The mesh graph of some nodes of one frame, for clustering. The cube root of a node's mass stands for the local
    /// element size.
    fn graph(&self, nodes: &[u32]) -> Graph {
        let places = nodes.iter().map(|n| self.place_in_frame(*n)).collect();
        let sizes = nodes.iter().map(|n| f64::from(self.node_rest[*n as usize][3]).cbrt()).collect();
        let mut index = vec![NONE; self.node_rest.len()];
        nodes.iter().enumerate().for_each(|(k, n)| index[*n as usize] = k as u32);
        let own = |t: &[u32; 4]| t.map(|n| index[n as usize]).into_iter().filter(|k| *k != NONE).collect();
        Graph::new(places, sizes, self.tetrahedra.iter().map(own))
    }

    /// Rest position of a node relative to the centre of its frame, m.
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
        // If the nodes lie in a plane or in a row, their displacements do not determine an affine motion across the
        // plane or row; the pseudo-inverse makes this part of the motion zero.
        let inverse = inverse_within(sum, LEAST_SPREAD * nodes.len() as f64);
        self.moments.push(texel(DVec3::new(inverse.x_axis.x, inverse.y_axis.y, inverse.z_axis.z), 0.0));
        self.moments.push(texel(DVec3::new(inverse.y_axis.x, inverse.z_axis.x, inverse.z_axis.y), 0.0));
        let info = |n: &u32| model.node_info[*n as usize];
        let damping = |n: &u32| model.node_damping[*n as usize].to_bits();
        self.nodes.extend(nodes.iter().map(|n| [*n, info(n)[0], info(n)[1], damping(n)]));
    }
}

/// Pseudo-inverse of a symmetric matrix: the inverse along eigenvectors whose eigenvalue exceeds `least`, zero along
/// the other eigenvectors.
fn inverse_within(matrix: DMat3, least: f64) -> DMat3 {
    let wide = Mat::from_fn(3, 3, |i, j| matrix.col(j)[i]);
    let Ok(eigen) = wide.self_adjoint_eigen(Side::Lower) else { return DMat3::ZERO };
    let (values, vectors) = (eigen.S(), eigen.U());
    (0..3).filter(|k| values[*k] > least).fold(DMat3::ZERO, |sum, k| {
        let axis = DVec3::new(vectors[(0, k)], vectors[(1, k)], vectors[(2, k)]);
        sum + DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * (1.0 / values[k])
    })
}
