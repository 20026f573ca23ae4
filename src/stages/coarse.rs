//! The coarse space of the solver's preconditioner: the matrix A of a step's linear system for bodies at rest,
//! restricted to a few motions (modes) of each block of nodes, and inverted before the first step (and anew when a
//! material changes). A block is a set of nodes of one soft body: free nodes that lie together (an aggregate), or nodes
//! attached to a core (a rigid body inside a soft one). Free nodes are attached to nothing.
//!
//! The preconditioner is a two-level additive Schwarz method (Dryja and Widlund 1987) with blocks in place of
//! subdomains: M^-1 = D^-1 + P A_c^-1 P^T, where D is the block diagonal of A (3x3 for each free node), P maps modes to
//! node velocities, and A_c = P^T A P is the Galerkin coarse matrix. P rotates with the blocks, so the inverse for
//! bodies at rest serves a body in any orientation. Contact and deformation are left out of A_c, which need not be
//! exact; of P the kernels leave out what stiff contacts resist (shaders/shared/preconditioner.glsl).

mod matrix;

use crate::shaders;
use std::collections::{BTreeMap, BTreeSet};

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, MatRef, Side};
use glam::DVec3;

use super::model::{Model, SoftRange};
use crate::scene::{Preconditioner, Solver};
use crate::shaders::NONE;

/// Number of modes per block. A block of free nodes has the twelve affine motions. A block of nodes attached to a core
/// has the core's twist (linear and angular velocity) as its first six modes; the others are unused.
pub const BLOCK_UNKNOWNS: usize = 12;
/// Stiffness number (see [`Model::stiffness_number`]) above which the coarse space saves time: an iteration with it takes
/// 1.6 to 1.9 times as long on a CPU. Measured on lavapipe, both preconditioners take equally long at numbers of about
/// 150 for 726 nodes and 400 for 2,123; 35,301 nodes gain a third at 672.
const STIFF: f64 = 200.0;
/// Least number of aggregates of a body that has enough free nodes for that many (see [`LEAST_NODES`]).
const LEAST_AGGREGATES: usize = 32;
/// Stiffness number above which a body has twice as many aggregates. An elastic wave then passes more than 70 nodes in a
/// step, further than compact bodies reach but not bodies with long limbs, in which iterations fall faster with the number
/// of aggregates: the human of 10,204 tetrahedra at 2 MPa, in steps of 10 ms, takes 209 iterations with 32, 88 with 64.
const VERY_STIFF: f64 = 5000.0;
/// Least number of aggregates for each rigid coordinate frame in which the body has free nodes. No aggregate has nodes of
/// two frames, and bones with frames of their own move the flesh around them in different ways.
const LEAST_PER_FRAME: usize = 4;
/// Largest number of aggregates of a body.
const MOST_AGGREGATES: usize = 200;
/// Number of free nodes that an aggregate needs, since fewer hardly determine an affine motion.
const LEAST_NODES: usize = 8;
/// An eigenvector of the 4x4 Gram matrix of the functions 1, x, y, z over a block's nodes counts as an independent
/// function if its eigenvalue is above this fraction of the largest eigenvalue. Where nodes lie in a plane or a row,
/// some of the functions are combinations of others.
const LEAST_MOTION: f64 = 1e-4;

/// The coarse space of all bodies that have one, as arrays for the solver's kernels. A slot is a block's place in the
/// vectors that hold the modes of all blocks; a texel is an array element of four 32-bit words.
#[derive(Debug, Clone, Default)]
pub struct Coarse {
    /// Per block: first texel of its rows in `inverse`, first slot of the block's body, number of the body's modes
    /// divided by four (0 where the body has no coarse space), and the block's own slot.
    pub blocks: Vec<[u32; 4]>,
    /// Rows of each body's inverse A_c^-1, scaled to a unit diagonal, in half precision: eight numbers per texel.
    pub inverse: Vec<[u32; 4]>,
    /// Square roots of the diagonal entries of these inverses before the scaling; three texels per slot.
    pub scales: Vec<[f32; 4]>,
    /// The bodies that have a coarse space: body index, stiffness number (see [`Model::stiffness_number`]), number of
    /// aggregates.
    pub bodies: Vec<(usize, f64, usize)>,
}

impl Model {
    /// Makes the blocks of all bodies, and the coarse space of some bodies, as the scene's `solver` says: with
    /// `Preconditioner::Auto`, bodies that are stiff enough at steps of `dt` seconds have a coarse space; with `Coarse`,
    /// all bodies that deform; with `Jacobi`, none.
    pub(super) fn add_coarse(&mut self, dt: f64, solver: &Solver) {
        let wanted = |index: usize| {
            let number = self.stiffness_number(&self.soft[index], dt);
            let has = match solver.preconditioner {
                Preconditioner::Auto => number > STIFF,
                Preconditioner::Jacobi => false,
                Preconditioner::Coarse => number > 0.0,
            };
            has.then(|| (number, self.aggregate_count(&self.soft[index], number)))
        };
        let wanted: Vec<_> = (0..self.soft.len()).map(wanted).collect();
        self.add_blocks(|index| wanted[index].map(|(_, count)| count));
        self.invert(dt, &wanted);
    }

    /// Like [`Model::add_coarse`] for a model that differs from `before` in materials alone: it takes over the blocks
    /// of `before`, and the choice of the bodies that have a coarse space.
    pub(super) fn add_coarse_like(&mut self, dt: f64, before: &Model) {
        self.add_blocks_of(before);
        let kept = |soft: &SoftRange| before.coarse.bodies.iter().find(|(body, ..)| *body == soft.body);
        let wanted: Vec<_> = self
            .soft
            .iter()
            .map(|soft| kept(soft).map(|(.., count)| (self.stiffness_number(soft, dt), *count)))
            .collect();
        self.invert(dt, &wanted);
    }

    /// Makes the coarse space of the bodies for which `wanted` has a stiffness number and a number of aggregates.
    fn invert(&mut self, dt: f64, wanted: &[Option<(f64, usize)>]) {
        let blocks: Vec<_> = self.blocks.coarse_indices.iter().map(|coarse_index| [0, 0, 0, *coarse_index]).collect();
        let scales = vec![[0.0; 4]; if wanted.iter().any(Option::is_some) { 3 * blocks.len() } else { 0 }];
        let mut coarse = Coarse { blocks, scales, ..Coarse::default() };
        for (index, (number, count)) in wanted.iter().enumerate().filter_map(|(i, w)| w.map(|w| (i, w))) {
            if self.invert_coarse(index, dt, &mut coarse) {
                coarse.bodies.push((self.soft[index].body, number, count));
            }
        }
        self.coarse = coarse;
    }

    /// Number of aggregates for a soft body with this stiffness number. It is chosen for the least time on a CPU: with B
    /// aggregates of n nodes, the number of iterations falls about as B^(-1/3), and the time of an iteration grows as n
    /// plus a share of B^2, that of the product with the dense inverse, so the best B grows as the square root of n. It
    /// is limited so that the matrix is inverted within a few seconds.
    fn aggregate_count(&self, soft: &SoftRange, number: f64) -> usize {
        let free: Vec<_> = soft.nodes.clone().filter(|n| self.node_info[*n][3] == shaders::NODE_FREE).collect();
        let frames: BTreeSet<u32> = free.iter().map(|n| self.node_info[*n][2]).collect();
        let wanted = LEAST_AGGREGATES.max((0.5 * (free.len() as f64).sqrt()) as usize);
        let wanted = if number > VERY_STIFF { 2 * wanted } else { wanted };
        wanted.max(LEAST_PER_FRAME * frames.len()).min(MOST_AGGREGATES).min(free.len().div_ceil(LEAST_NODES)).max(1)
    }

    /// Stiffness number of a body: the ratio of a node's stiffness to its inertia in a step of h = `dt` seconds, (h^2 +
    /// h beta) tr(K_ii) / (3 (1 + h alpha) m_i) for node i, with K_ii its 3x3 diagonal block of the stiffness matrix,
    /// m_i its mass, and alpha and beta the coefficients of mass- and stiffness-proportional damping. The body's number
    /// is the 95th percentile over its free nodes, or 0 where no node is free. With a 3x3 block Jacobi preconditioner,
    /// the number of iterations in which conjugate gradients reduce the relative residual to 1e-4 is about 9 times the
    /// square root of the stiffness number; it is less where the body is so small that its size limits the iterations.
    pub fn stiffness_number(&self, soft: &SoftRange, dt: f64) -> f64 {
        let mut stiffness = vec![0.0; soft.nodes.len()];
        for t in self.tetrahedra_of(soft) {
            let [mu, lambda, beta] = self.material_of(t);
            let factor = (dt * dt + dt * beta) * self.volume(t);
            for (i, g) in self.tetrahedra[t].iter().zip(self.gradients_of(t)) {
                stiffness[*i as usize - soft.nodes.start] += factor * (4.0 * mu + lambda) * g.length_squared();
            }
        }
        let number = |n: usize| stiffness[n - soft.nodes.start] / (3.0 * self.inertia(n, dt));
        let free = soft.nodes.clone().filter(|n| self.node_info[*n][3] == shaders::NODE_FREE);
        let mut numbers: Vec<f64> = free.map(number).collect();
        numbers.sort_by(f64::total_cmp);
        numbers.get(numbers.len() * 19 / 20).copied().unwrap_or_default()
    }

    fn tetrahedra_of(&self, soft: &SoftRange) -> impl Iterator<Item = usize> {
        (0..self.tetrahedra.len()).filter(|t| soft.nodes.contains(&(self.tetrahedra[*t][0] as usize)))
    }

    /// Mass term m + h alpha m of a node in the matrix A, kg, with h = `dt` in seconds and alpha (1/s) the coefficient
    /// of mass-proportional damping.
    fn inertia(&self, node: usize, dt: f64) -> f64 {
        f64::from(self.node_rest[node][3]) + dt * f64::from(self.node_damping[node])
    }

    /// Gradients of a tetrahedron's four shape functions at rest, 1/m.
    fn gradients_of(&self, tetrahedron: usize) -> [DVec3; 4] {
        let wide = |k: usize| DVec3::from_slice(&self.rest_gradients[3 * tetrahedron + k].map(f64::from)[..3]);
        [-wide(0) - wide(1) - wide(2), wide(0), wide(1), wide(2)]
    }

    /// Lame parameters mu and lambda (Pa) and stiffness-proportional damping beta (s) of a tetrahedron.
    pub(crate) fn material_of(&self, tetrahedron: usize) -> [f64; 3] {
        let material = self.materials[self.element_info[tetrahedron][0] as usize];
        [material.mu, material.lambda, material.damping].map(f64::from)
    }

    /// Rest volume of a tetrahedron, m^3.
    pub(crate) fn volume(&self, tetrahedron: usize) -> f64 {
        f64::from(self.rest_gradients[3 * tetrahedron][3]).powi(2)
    }

    /// Adds the inverse of a body's coarse matrix to `coarse`. Returns false where there is no inverse: the body has no
    /// block, or its matrix is not positive definite.
    fn invert_coarse(&self, index: usize, dt: f64, coarse: &mut Coarse) -> bool {
        let soft = &self.soft[index];
        let own = |b: &usize| self.body_of(self.blocks.nodes[self.blocks.blocks[*b][0] as usize][0]) == index;
        let mut blocks: Vec<usize> = (0..self.blocks.blocks.len()).filter(own).collect();
        blocks.sort_by_key(|b| self.blocks.coarse_indices[*b]);
        let Some(first_coarse_index) = blocks.first().map(|b| self.blocks.coarse_indices[*b]) else { return false };
        let size = BLOCK_UNKNOWNS * blocks.len();
        // The columns of E are the independent motions in terms of the modes; the inverse on the modes is E (E^T A_c
        // E)^-1 E^T.
        let (matrix, motions) = (self.coarse_matrix(soft, &blocks, dt), self.motions(&blocks));
        let half = combined(&motions, matrix.as_ref());
        let reduced = combined(&motions, half.transpose());
        let Ok(factor) = reduced.llt(Side::Lower) else { return false };
        let Some(inverse) = HalfInverse::new(&motions, &factor.inverse(), size) else { return false };
        let texels = size.div_ceil(8);
        let first_texel = coarse.inverse.len();
        let mut rows = vec![half::f16::ZERO; size * 8 * texels];
        for i in 0..size {
            (0..size).for_each(|j| rows[i * 8 * texels + j] = inverse.values[i * size + j]);
            coarse.scales[3 * first_coarse_index as usize + i / 4][i % 4] = inverse.scales[i] as f32;
        }
        let pair = |x: &[half::f16]| u32::from(x[0].to_bits()) | u32::from(x[1].to_bits()) << 16;
        coarse.inverse.extend(rows.chunks(8).map(|x| [0, 2, 4, 6].map(|k| pair(&x[k..]))));
        (0..blocks.len()).for_each(|k| {
            let first = first_texel + k * BLOCK_UNKNOWNS * texels;
            coarse.blocks[blocks[k]] =
                [first as u32, first_coarse_index, (size / 4) as u32, first_coarse_index + k as u32];
        });
        true
    }

    /// Linearly independent motions of a body's blocks, each as the index and the weight of every mode that it
    /// combines: all blocks of a core move as one, and a hinged core only rotates about its hinge.
    fn motions(&self, blocks: &[usize]) -> Vec<Vec<(usize, f64)>> {
        let mut motions = Vec::new();
        let mut cores: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (k, b) in blocks.iter().enumerate() {
            let [.., rigid] = self.blocks.blocks[*b];
            if rigid != NONE {
                cores.entry(rigid).or_default().push(BLOCK_UNKNOWNS * k);
                continue;
            }
            for weights in self.affine_motions(*b) {
                let mode =
                    |axis: usize| weights.iter().enumerate().map(move |(m, w)| (BLOCK_UNKNOWNS * k + 3 * m + axis, *w));
                motions.extend((0..3).map(|axis| mode(axis).filter(|(_, w)| *w != 0.0).collect()));
            }
        }
        for (rigid, modes) in cores {
            let core = &self.cores[rigid as usize];
            let axis = self.frames[core.frame].orientation.conjugate() * core.hinge;
            let along = |from: usize, axis: DVec3| -> Vec<(usize, f64)> {
                let of_block = |first: &usize| (0..3).map(|k| (first + from + k, axis[k])).collect::<Vec<_>>();
                modes.iter().flat_map(of_block).filter(|(_, w)| *w != 0.0).collect()
            };
            if axis != DVec3::ZERO {
                motions.push(along(3, axis));
                continue;
            }
            motions.extend([0, 3].iter().flat_map(|from| DVec3::AXES.map(|axis| along(*from, axis))));
        }
        motions
    }

    /// Linearly independent affine functions over a block's nodes, each as its weights of 1, x, y and z: these four
    /// functions themselves where they are independent, otherwise combinations of them.
    fn affine_motions(&self, block: usize) -> Vec<[f64; 4]> {
        let [first, count, ..] = self.blocks.blocks[block];
        let nodes = &self.blocks.nodes[first as usize..(first + count) as usize];
        let weights: Vec<_> = nodes.iter().map(|n| self.affine_weights(block, n[0])).collect();
        let square = Mat::from_fn(4, 4, |i, j| weights.iter().map(|w| w[i] * w[j]).sum::<f64>());
        let Ok(eigen) = square.self_adjoint_eigen(Side::Lower) else { return Vec::new() };
        let own: Vec<usize> = (0..4).filter(|k| eigen.S()[*k] > LEAST_MOTION * eigen.S()[3]).collect();
        let unit = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        if own.len() == 4 {
            return (0..4).map(unit).collect();
        }
        own.iter().map(|k| std::array::from_fn(|i| eigen.U()[(i, *k)])).collect()
    }

    fn affine_weights(&self, block: usize, node: u32) -> [f64; 4] {
        let [x, y, z, inverse_size] = self.blocks.places[block].map(f64::from);
        let at = (self.place_in_frame(node) - DVec3::new(x, y, z)) * inverse_size;
        [1.0, at.x, at.y, at.z]
    }
}

/// The inverse of a body's coarse matrix, E X E^T, scaled to a unit diagonal and rounded to half precision, where the
/// columns of E are the body's independent motions and X is the inverse of E^T A_c E.
struct HalfInverse {
    /// The rounded matrix, row by row.
    values: Vec<half::f16>,
    /// Square roots of the diagonal entries before the scaling; zero for modes that no motion contains.
    scales: Vec<f64>,
}

impl HalfInverse {
    /// `x` is X, symmetric and positive definite. Where bodies are stiff, rounding can make E X E^T indefinite, but
    /// conjugate gradients need a positive definite preconditioner. In that case the diagonal of X is raised by a
    /// fraction of itself, 2^-11 at first and then doubled as often as needed, until the rounded matrix is positive
    /// definite. Returns `None` where even the fraction 2^-5 is not enough.
    fn new(motions: &[Vec<(usize, f64)>], x: &Mat<f64>, size: usize) -> Option<HalfInverse> {
        let shifts = std::iter::once(0.0).chain((5..=11).rev().map(|k| 0.5f64.powi(k)));
        shifts.map(|shift| HalfInverse::shifted(motions, x, size, shift)).find(|half| half.is_positive(motions, size))
    }

    fn shifted(motions: &[Vec<(usize, f64)>], x: &Mat<f64>, size: usize, shift: f64) -> HalfInverse {
        let mut x = x.clone();
        (0..x.nrows()).for_each(|k| x[(k, k)] *= 1.0 + shift);
        let half = spread(motions, x.as_ref(), size);
        let inverse = spread(motions, half.transpose(), size);
        let scales: Vec<f64> = (0..size).map(|i| inverse[(i, i)].max(0.0).sqrt()).collect();
        let mut values = vec![half::f16::ZERO; size * size];
        for i in (0..size).filter(|i| scales[*i] > 0.0) {
            for j in (0..size).filter(|j| scales[*j] > 0.0) {
                // Both triangles of the matrix take the same entry, so that the matrix is symmetric to the last bit.
                let value = inverse[(i.max(j), i.min(j))] / (scales[i] * scales[j]);
                values[i * size + j] = half::f16::from_f64(value);
            }
        }
        HalfInverse { values, scales }
    }

    /// Whether the rounded matrix is positive definite on the independent motions.
    fn is_positive(&self, motions: &[Vec<(usize, f64)>], size: usize) -> bool {
        let value = |i: usize, j: usize| self.values[i * size + j].to_f64() * self.scales[i] * self.scales[j];
        let all = Mat::from_fn(size, size, value);
        let half = combined(motions, all.as_ref());
        combined(motions, half.transpose()).llt(Side::Lower).is_ok()
    }
}

/// E^T times a matrix, where the columns of E are the motions.
fn combined(motions: &[Vec<(usize, f64)>], matrix: MatRef<f64>) -> Mat<f64> {
    Mat::from_fn(motions.len(), matrix.ncols(), |i, j| motions[i].iter().map(|(k, w)| w * matrix[(*k, j)]).sum::<f64>())
}

/// E times a matrix, where the columns of E are the motions, and E has a row for each of `modes` modes.
fn spread(motions: &[Vec<(usize, f64)>], matrix: MatRef<f64>, modes: usize) -> Mat<f64> {
    let mut all = Mat::zeros(modes, matrix.ncols());
    for (i, motion) in motions.iter().enumerate() {
        for (k, w) in motion {
            (0..matrix.ncols()).for_each(|j| all[(*k, j)] += w * matrix[(i, j)]);
        }
    }
    all
}
