//! What A does at rest to motions of a body's nodes, summed over them.

use std::collections::BTreeMap;

use faer::Mat;
use glam::{DMat3, DVec3};

use super::super::model::{Core, Model, SoftRange};
use super::MODES;
use crate::shaders::NONE;

impl Model {
    /// P^T A P at rest, without contact and the limits of joints; of cores as if none was hinged.
    pub(super) fn coarse_matrix(&self, soft: &SoftRange, blocks: &[usize], dt: f64) -> Mat<f64> {
        let mut bases: Vec<Option<(usize, Basis)>> = vec![None; soft.nodes.len()];
        for (k, b) in blocks.iter().enumerate() {
            let [first, count, _, rigid] = self.blocks.blocks[*b];
            for node in &self.blocks.nodes[first as usize..(first + count) as usize] {
                let basis = Basis::new(self, *b, node[0], rigid);
                bases[node[0] as usize - soft.nodes.start] = Some((MODES * k, basis));
            }
        }
        let mut matrix = self.restricted(soft, &bases, MODES * blocks.len(), dt);
        // Of a core's blocks, which have the same six modes, the first.
        let first_mode = |core: usize| {
            let first = blocks.iter().position(|b| *b == self.blocks.cores[core].1.start)?;
            Some(MODES * first)
        };
        self.add_springs(&mut matrix, dt, first_mode);
        matrix
    }

    /// What A does at rest, without contact and joints, to a core's twist in its frame's axes, while all other nodes stay.
    pub(in super::super) fn core_block(&self, core: &Core, dt: f64) -> Mat<f64> {
        let own = |soft: &&SoftRange| core.nodes.iter().all(|n| soft.nodes.contains(&(*n as usize)));
        let Some(soft) = self.soft.iter().find(own) else { return Mat::zeros(6, 6) };
        let mut bases = vec![None; soft.nodes.len()];
        for node in &core.nodes {
            bases[*node as usize - soft.nodes.start] = Some((0, Basis::twist(self, *node)));
        }
        self.restricted(soft, &bases, 6, dt)
    }

    /// P^T A P at rest, without contact and joints, of a soft body; `bases`: of each of its nodes, and their first modes.
    fn restricted(&self, soft: &SoftRange, bases: &[Option<(usize, Basis)>], modes: usize, dt: f64) -> Mat<f64> {
        let basis = |n: usize| bases[n - soft.nodes.start].as_ref();
        let mut matrix = Mat::zeros(modes, modes);
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

/// How a node moves with the modes of its block, in rest axes.
#[derive(Debug, Clone)]
enum Basis {
    /// c0 + c1 x + c2 y + c3 z.
    Affine([f64; 4]),
    /// linear + angular x arm, as the matrix of the second.
    Twist(DMat3),
}

impl Basis {
    fn new(model: &Model, block: usize, node: u32, rigid: u32) -> Basis {
        if rigid == NONE {
            return Basis::Affine(model.affine_weights(block, node));
        }
        Basis::twist(model, node)
    }

    fn twist(model: &Model, node: u32) -> Basis {
        let place = model.place_in_frame(node);
        Basis::Twist(DMat3::from_cols(DVec3::X.cross(place), DVec3::Y.cross(place), DVec3::Z.cross(place)))
    }

    /// Its parts as 3x3 matrices of three modes each.
    fn matrices(&self) -> Vec<DMat3> {
        match self {
            Basis::Affine(weights) => weights.iter().map(|w| DMat3::from_diagonal(DVec3::splat(*w))).collect(),
            Basis::Twist(angular) => vec![DMat3::IDENTITY, *angular],
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
