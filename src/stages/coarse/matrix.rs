//! The Galerkin coarse matrix A_c = P^T A P of a soft body at rest: A is the matrix of implicit Euler with step h =
//! `dt`, (1 + h alpha) M + (h^2 + h beta) K, with M the mass and K the stiffness matrix, alpha and beta the mass and
//! stiffness damping; P maps the modes of blocks of nodes to node velocities (see `coarse.rs`). A core is a rigid body
//! inside the soft one, to which nodes are attached.

use std::collections::BTreeMap;

use faer::Mat;
use glam::{DMat3, DVec3};

use super::super::model::{Core, Model, SoftRange};
use super::BLOCK_UNKNOWNS;
use crate::shaders::NONE;

impl Model {
    /// P^T A P at rest, without contact and without the limits of joints; hinged cores are treated as if they moved
    /// freely.
    pub(super) fn coarse_matrix(&self, soft: &SoftRange, blocks: &[usize], dt: f64) -> Mat<f64> {
        let mut bases: Vec<Option<(usize, Basis)>> = vec![None; soft.nodes.len()];
        for (k, b) in blocks.iter().enumerate() {
            let [first, count, _, rigid] = self.blocks.blocks[*b];
            for node in &self.blocks.nodes[first as usize..(first + count) as usize] {
                let basis = Basis::new(self, *b, node[0], rigid);
                bases[node[0] as usize - soft.nodes.start] = Some((BLOCK_UNKNOWNS * k, basis));
            }
        }
        let mut matrix = self.restricted(soft, &bases, BLOCK_UNKNOWNS * blocks.len(), dt);
        // All blocks of a core move with its one twist; a joint's springs are added to the modes of the core's first
        // block alone.
        let first_unknown = |core: usize| {
            let first = blocks.iter().position(|b| *b == self.blocks.cores[core].1.start)?;
            Some(BLOCK_UNKNOWNS * first)
        };
        self.add_springs(&mut matrix, dt, first_unknown);
        matrix
    }

    /// A at rest, without contact and joints, restricted to the twist of a core in its frame's axes (linear, then
    /// angular) while all other nodes stay still.
    pub(in super::super) fn core_block(&self, core: &Core, dt: f64) -> Mat<f64> {
        let own = |soft: &&SoftRange| core.nodes.iter().all(|n| soft.nodes.contains(&(*n as usize)));
        let Some(soft) = self.soft.iter().find(own) else { return Mat::zeros(6, 6) };
        let mut bases = vec![None; soft.nodes.len()];
        for node in &core.nodes {
            bases[*node as usize - soft.nodes.start] = Some((0, Basis::twist(self, *node)));
        }
        self.restricted(soft, &bases, 6, dt)
    }

    /// P^T A P of a soft body at rest, without contact and joints. `bases`: for each of its nodes the first mode of its
    /// block and its basis functions, `None` for a node that does not move; `modes`: the size of the matrix.
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

    /// Adds the part c c^T of an F-bar patch (tetrahedra e that share one volumetric strain), c_j = sqrt((h^2 + h beta)
    /// lambda / V) sum_e V_e g_ej for node j, with V_e volumes, V their sum, g rest gradients and lambda the Lame
    /// parameter.
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
    /// Velocity c0 + c1 x + c2 y + c3 z of a free node, as the weights 1, x, y, z of the modes.
    Affine([f64; 4]),
    /// Velocity linear + angular x arm of an attached node, as the matrix that maps angular to angular x arm.
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

    /// The basis functions as 3x3 matrices, each for three modes.
    fn matrices(&self) -> Vec<DMat3> {
        match self {
            Basis::Affine(weights) => weights.iter().map(|w| DMat3::from_diagonal(DVec3::splat(*w))).collect(),
            Basis::Twist(angular) => vec![DMat3::IDENTITY, *angular],
        }
    }
}

/// Adds left^T block right, where `left` and `right` are two nodes' first modes and bases, and `block` is their 3x3
/// block of A.
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
