//! The coarse level of the preconditioner: what A does at rest to affine motions of each block of nodes, inverted once.
//!
//! Two-level additive Schwarz (Dryja and Widlund 1987) with aggregates in the place of subdomains: M^-1 = D^-1 + P A_c^-1
//! P^T. P turns with the frames, so the matrix at rest serves whatever way a body has turned; contact and deformation are
//! not in it, and need not be.

use std::collections::BTreeMap;

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};
use glam::{DMat3, DVec3};

use super::layers::held;
use super::model::{Model, SoftRange};
use super::types::NONE;
use crate::scene::Preconditioner;

/// Modes of a block: twelve affine ones of free nodes, or the six of a twist and six that are none.
pub const MODES: usize = 12;
/// Stiffness number from which the coarse level pays; see [`Model::stiffness_number`].
const STIFF: f64 = 10.0;
/// Aggregates of a body that has enough nodes for them.
const LEAST_AGGREGATES: usize = 64;
/// And at most.
const MOST_AGGREGATES: usize = 200;
/// Nodes of an aggregate at least: fewer hardly know affine motions.
const LEAST_NODES: usize = 8;
/// Of the diagonal, added to it: what no node of a block feels of its modes would make the matrix singular.
const REGULAR: f64 = 1e-6;

/// The coarse level of all bodies that have one.
#[derive(Debug, Clone, Default)]
pub struct Coarse {
    /// First texel of a block's rows, first slot of its body, that body's modes over four (none without a coarse level), its
    /// slot.
    pub blocks: Vec<[u32; 4]>,
    /// Rows of the inverses, scaled to a diagonal of one: half precision, eight numbers a texel.
    pub inverse: Vec<[u32; 4]>,
    /// The roots of the inverses' diagonals; three texels a slot.
    pub scales: Vec<[f32; 4]>,
    /// Bodies that have it, with their stiffness number and their aggregates.
    pub bodies: Vec<(usize, f64, usize)>,
}

impl Model {
    /// Blocks of all bodies, and the coarse level of those that are stiff enough at steps of `dt` seconds, or as asked.
    pub(super) fn add_coarse(&mut self, dt: f64, asked: Preconditioner) {
        let wanted = |index: usize| {
            let number = self.stiffness_number(&self.soft[index], dt);
            let has = match asked {
                Preconditioner::Auto => number > STIFF,
                Preconditioner::Jacobi => false,
                Preconditioner::Coarse => number > 0.0,
            };
            has.then(|| (number, aggregates(self.free_count(&self.soft[index]))))
        };
        let wanted: Vec<_> = (0..self.soft.len()).map(wanted).collect();
        self.add_blocks(|index| wanted[index].map(|(_, count)| count));
        let blocks: Vec<_> = self.blocks.slots.iter().map(|slot| [0, 0, 0, *slot]).collect();
        let scales = vec![[0.0; 4]; if wanted.iter().any(Option::is_some) { 3 * blocks.len() } else { 0 }];
        let mut coarse = Coarse { blocks, scales, ..Coarse::default() };
        for (index, (number, count)) in wanted.iter().enumerate().filter_map(|(i, w)| w.map(|w| (i, w))) {
            if self.invert_coarse(index, dt, &mut coarse) {
                coarse.bodies.push((self.soft[index].body, number, count));
            }
        }
        self.coarse = coarse;
    }

    fn free_count(&self, soft: &SoftRange) -> usize {
        soft.nodes.clone().filter(|n| self.node_info[*n][3] == held::FREE).count()
    }

    /// How much stiffer than its inertia a node is, in a step of `dt` seconds: (h^2 + h beta) tr(K_ii) / (3 (1 + h alpha)
    /// m_i), the 95th of a hundred free nodes; 0 where none is free. Conjugate gradients with 3x3 block Jacobi take some 9
    /// times its root of iterations to 1e-4, until the body ends them.
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
        let free = soft.nodes.clone().filter(|n| self.node_info[*n][3] == held::FREE);
        let mut numbers: Vec<f64> = free.map(number).collect();
        numbers.sort_by(f64::total_cmp);
        numbers.get(numbers.len() * 19 / 20).copied().unwrap_or_default()
    }

    fn tetrahedra_of(&self, soft: &SoftRange) -> impl Iterator<Item = usize> {
        (0..self.tetrahedra.len()).filter(|t| soft.nodes.contains(&(self.tetrahedra[*t][0] as usize)))
    }

    /// m + h alpha m of a node, kg.
    fn inertia(&self, node: usize, dt: f64) -> f64 {
        f64::from(self.node_rest[node][3]) + dt * f64::from(self.node_damping[node])
    }

    /// Gradients of a tetrahedron's four shape functions at rest, 1/m.
    fn gradients_of(&self, tetrahedron: usize) -> [DVec3; 4] {
        let wide = |k: usize| DVec3::from_slice(&self.rest_gradients[3 * tetrahedron + k].map(f64::from)[..3]);
        [-wide(0) - wide(1) - wide(2), wide(0), wide(1), wide(2)]
    }

    /// mu, lambda, Pa, and beta, s.
    fn material_of(&self, tetrahedron: usize) -> [f64; 3] {
        let [mu, lambda, _, beta] = self.materials[self.rest_gradients[3 * tetrahedron + 1][3] as usize];
        [mu, lambda, beta].map(f64::from)
    }

    fn volume(&self, tetrahedron: usize) -> f64 {
        f64::from(self.rest_gradients[3 * tetrahedron][3]).powi(2)
    }

    /// Adds the inverse of a body's coarse matrix; false where it has none (nothing is free, or it is singular).
    fn invert_coarse(&self, index: usize, dt: f64, coarse: &mut Coarse) -> bool {
        let soft = &self.soft[index];
        let own = |b: &usize| self.body_of(self.blocks.nodes[self.blocks.blocks[*b][0] as usize][0]) == index;
        let mut blocks: Vec<usize> = (0..self.blocks.blocks.len()).filter(own).collect();
        blocks.sort_by_key(|b| self.blocks.slots[*b]);
        let Some(first_slot) = blocks.first().map(|b| self.blocks.slots[*b]) else { return false };
        // The blocks of one core have its six modes in common: those of the first stand for all.
        let first_of = |k: usize| match self.blocks.blocks[blocks[k]][3] {
            NONE => k,
            core => (0..k).find(|l| self.blocks.blocks[blocks[*l]][3] == core).unwrap_or(k),
        };
        let stands: Vec<usize> = (0..blocks.len()).map(first_of).collect();
        let size = MODES * blocks.len();
        let matrix = self.coarse_matrix(soft, &blocks, &stands, dt);
        // The others move nothing: a core has six, fewer on a hinge.
        let used: Vec<usize> = (0..size).filter(|i| matrix[(*i, *i)] > 0.0).collect();
        let packed = Mat::from_fn(used.len(), used.len(), |i, j| {
            matrix[(used[i], used[j])] * if i == j { 1.0 + REGULAR } else { 1.0 }
        });
        let Ok(factor) = packed.llt(Side::Lower) else { return false };
        let inverse = factor.inverse();
        let place = |mode: usize| used.binary_search(&(MODES * stands[mode / MODES] + mode % MODES)).ok();
        let places: Vec<(usize, usize)> = (0..size).filter_map(|mode| Some((mode, place(mode)?))).collect();
        let texels = size.div_ceil(8);
        let first_texel = coarse.inverse.len();
        let mut rows = vec![half::f16::ZERO; size * 8 * texels];
        let scales: Vec<f64> = (0..used.len()).map(|i| inverse[(i, i)].sqrt()).collect();
        for (row, i) in &places {
            for (column, j) in &places {
                // Symmetric to the last bit.
                let value = inverse[(*i.max(j), *i.min(j))] / (scales[*i] * scales[*j]);
                rows[row * 8 * texels + column] = half::f16::from_f64(value);
            }
            coarse.scales[3 * first_slot as usize + row / 4][row % 4] = scales[*i] as f32;
        }
        let pair = |x: &[half::f16]| u32::from(x[0].to_bits()) | u32::from(x[1].to_bits()) << 16;
        coarse.inverse.extend(rows.chunks(8).map(|x| [0, 2, 4, 6].map(|k| pair(&x[k..]))));
        (0..blocks.len()).for_each(|k| {
            let first = first_texel + k * MODES * texels;
            coarse.blocks[blocks[k]] = [first as u32, first_slot, (size / 4) as u32, first_slot + k as u32];
        });
        true
    }

    /// P^T A P at rest, without contact; a block's modes stand where `stands` says.
    fn coarse_matrix(&self, soft: &SoftRange, blocks: &[usize], stands: &[usize], dt: f64) -> Mat<f64> {
        let mut bases: Vec<Option<(usize, Basis)>> = vec![None; soft.nodes.len()];
        for (k, b) in blocks.iter().enumerate() {
            let [first, count, frame, rigid] = self.blocks.blocks[*b];
            for node in &self.blocks.nodes[first as usize..(first + count) as usize] {
                let basis = Basis::new(self, *b, node[0], frame as usize, rigid);
                bases[node[0] as usize - soft.nodes.start] = Some((MODES * stands[k], basis));
            }
        }
        let basis = |n: usize| bases[n - soft.nodes.start].as_ref();
        let mut matrix = Mat::zeros(MODES * blocks.len(), MODES * blocks.len());
        for n in soft.nodes.clone() {
            let mass = self.inertia(n, dt);
            if let Some((at, basis)) = basis(n) {
                add_product(&mut matrix, (*at, basis), (*at, basis), &(mass * DMat3::IDENTITY));
            }
        }
        for t in self.tetrahedra_of(soft) {
            let [mu, lambda, beta] = self.material_of(t);
            let lambda = if self.patches.of[t] == NONE { lambda } else { 0.0 };
            let factor = (dt * dt + dt * beta) * self.volume(t);
            let g = self.gradients_of(t);
            for (i, k) in self.tetrahedra[t].iter().zip(g) {
                for (j, l) in self.tetrahedra[t].iter().zip(g) {
                    let (Some((row, left)), Some((column, right))) = (basis(*i as usize), basis(*j as usize)) else {
                        continue;
                    };
                    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
                    let shear = DMat3::from_diagonal(DVec3::splat(k.dot(l))) + outer(l, k);
                    let block = (mu * shear + lambda * outer(k, l)) * factor;
                    add_product(&mut matrix, (*row, left), (*column, right), &block);
                }
            }
        }
        for p in self.patches.within(&soft.nodes) {
            self.add_patch(&mut matrix, p, dt, &basis);
        }
        matrix
    }

    /// Adds c c^T of a patch, c_j = sqrt((h^2 + h beta) lambda / V) sum V_e g_ej.
    fn add_patch<'a>(
        &self,
        matrix: &mut Mat<f64>,
        patch: usize,
        dt: f64,
        basis: &impl Fn(usize) -> Option<&'a (usize, Basis)>,
    ) {
        let [volume, lambda, beta, _] = self.patches.constants[patch].map(f64::from);
        let scale = ((dt * dt + dt * beta) * lambda / volume).sqrt();
        let mut row: BTreeMap<usize, f64> = BTreeMap::new();
        for t in self.patches.members_of(patch) {
            for (i, g) in self.tetrahedra[t].iter().zip(self.gradients_of(t)) {
                let Some((at, basis)) = basis(*i as usize) else { continue };
                for (k, part) in basis.matrices().iter().enumerate() {
                    let along = scale * self.volume(t) * (part.transpose() * g);
                    (0..3).for_each(|axis| *row.entry(at + 3 * k + axis).or_default() += along[axis]);
                }
            }
        }
        for (i, x) in &row {
            for (j, y) in &row {
                matrix[(*i, *j)] += x * y;
            }
        }
    }
}

/// Aggregates of a body of so many free nodes: their number grows so that the product with the inverse stays within a tenth
/// of an iteration, up to a matrix that is inverted in a few seconds.
fn aggregates(nodes: usize) -> usize {
    let wanted = (0.95 * (nodes as f64).sqrt()) as usize;
    wanted.clamp(LEAST_AGGREGATES, MOST_AGGREGATES).min(nodes.div_ceil(LEAST_NODES)).max(1)
}

/// How a node moves with the modes of its block, in rest axes.
#[derive(Debug, Clone)]
enum Basis {
    /// c0 + c1 x + c2 y + c3 z.
    Affine([f64; 4]),
    /// linear + angular x arm, as far as a hinge lets it.
    Twist([DMat3; 2]),
}

impl Basis {
    fn new(model: &Model, block: usize, node: u32, frame: usize, rigid: u32) -> Basis {
        let place = model.place_in_frame(node);
        if rigid == NONE {
            let [x, y, z, inverse_size] = model.blocks.places[block].map(f64::from);
            let at = (place - DVec3::new(x, y, z)) * inverse_size;
            return Basis::Affine([1.0, at.x, at.y, at.z]);
        }
        let axis = model.frames[frame].orientation.conjugate() * model.cores[rigid as usize].hinge;
        let (linear, angular) = if axis == DVec3::ZERO {
            (DMat3::IDENTITY, DMat3::IDENTITY)
        } else {
            (DMat3::ZERO, DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z))
        };
        let cross = DMat3::from_cols(place.cross(DVec3::X), place.cross(DVec3::Y), place.cross(DVec3::Z));
        Basis::Twist([linear, -cross * angular])
    }

    /// Its parts as 3x3 matrices of three modes each.
    fn matrices(&self) -> Vec<DMat3> {
        match self {
            Basis::Affine(weights) => weights.iter().map(|w| DMat3::from_diagonal(DVec3::splat(*w))).collect(),
            Basis::Twist(matrices) => matrices.to_vec(),
        }
    }
}

/// Adds left^T block right.
fn add_product(matrix: &mut Mat<f64>, left: (usize, &Basis), right: (usize, &Basis), block: &DMat3) {
    if let (Basis::Affine(a), Basis::Affine(b)) = (left.1, right.1) {
        for (m, x) in b.iter().enumerate() {
            for (k, y) in a.iter().enumerate() {
                for column in 0..3 {
                    for row in 0..3 {
                        matrix[(left.0 + 3 * k + row, right.0 + 3 * m + column)] += x * y * block.col(column)[row];
                    }
                }
            }
        }
        return;
    }
    for (k, a) in left.1.matrices().iter().enumerate() {
        for (m, b) in right.1.matrices().iter().enumerate() {
            let product = a.transpose() * *block * *b;
            for column in 0..3 {
                for row in 0..3 {
                    matrix[(left.0 + 3 * k + row, right.0 + 3 * m + column)] += product.col(column)[row];
                }
            }
        }
    }
}
