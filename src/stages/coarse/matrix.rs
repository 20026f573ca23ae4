//! The Galerkin coarse matrix A_c = P^T A P of a soft body at rest, made before the first step (and anew when a
//! material changes) for the solver's preconditioner (see `coarse.rs`). A is the matrix of implicit Euler with step h =
//! `dt`, (1 + h alpha) M + (h^2 + h beta) K, with mass matrix M, stiffness matrix K, and the coefficients alpha and
//! beta of mass- and stiffness-proportional damping. P maps the motions (modes) of blocks of nodes to node velocities:
//! a block of free nodes moves by affine functions (as far as supports let it), and the nodes attached to a core, a rigid body inside the soft one,
//! by the core's twist (linear and angular velocity).

use std::collections::BTreeMap;

use faer::Mat;
use glam::{DMat3, DVec3};

use super::super::model::{Core, Model, SoftRange};
use super::BLOCK_UNKNOWNS;
use crate::shaders::NONE;

/// Stiffness that is given to a node along the directions in which supports hold it, as a share of the mean of its own.
const FILL: f64 = 0.01;

impl Model {
    /// P^T A P of these blocks at rest, without contact and without the limits of joints; hinged cores are treated as
    /// if they moved freely.
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
        self.fill_supported(&mut matrix, soft, &bases, dt);
        // All blocks of a core move with the core's twist, so it suffices to add a joint's springs to the modes of the
        // core's first block.
        let first_unknown = |core: usize| {
            let first = blocks.iter().position(|b| *b == self.blocks.cores[core].1.start)?;
            Some(BLOCK_UNKNOWNS * first)
        };
        self.add_springs(&mut matrix, dt, first_unknown);
        matrix
    }

    /// Adds a little stiffness to the motions of blocks along which supports hold nodes (see [`FILL`]), so that the matrix
    /// can be inverted where a block has no other nodes.
    fn fill_supported(&self, matrix: &mut Mat<f64>, soft: &SoftRange, bases: &[Option<(usize, Basis)>], dt: f64) {
        if self.held.nodes.is_empty() {
            return;
        }
        let mut stiffness: Vec<f64> = soft.nodes.clone().map(|n| self.inertia(n, dt)).collect();
        for t in self.tetrahedra_of(soft) {
            let [mu, lambda, beta] = self.material_of(t);
            let factor = (dt * dt + dt * beta) * self.volume(t) * (4.0 * mu + lambda) / 3.0;
            for (i, g) in self.tetrahedra[t].iter().zip(self.gradients_of(t)) {
                stiffness[*i as usize - soft.nodes.start] += factor * g.length_squared();
            }
        }
        for (basis, stiffness) in bases.iter().zip(stiffness) {
            if let Some((at, Basis::Supported(weights, projection))) = basis {
                let basis = Basis::Affine(*weights);
                let block = (DMat3::IDENTITY - *projection) * (FILL * stiffness);
                add_product(matrix, (*at, &basis), (*at, &basis), &block);
            }
        }
    }

    /// A at rest, without contact and joints, restricted to the twist of a core in the axes of its rigid coordinate
    /// frame (linear, then angular part), while all nodes that are not attached to the core stay still.
    pub(in super::super) fn core_block(&self, core: &Core, dt: f64) -> Mat<f64> {
        let own = |soft: &&SoftRange| core.nodes.iter().all(|n| soft.nodes.contains(&(*n as usize)));
        let Some(soft) = self.soft.iter().find(own) else { return Mat::zeros(6, 6) };
        let mut bases = vec![None; soft.nodes.len()];
        for node in &core.nodes {
            bases[*node as usize - soft.nodes.start] = Some((0, Basis::twist(self, *node)));
        }
        self.restricted(soft, &bases, 6, dt)
    }

    /// P^T A P of a soft body at rest, without contact and joints. `bases`: for each of the body's nodes the first mode
    /// of the node's block and the node's basis functions, `None` for a node that does not move; `modes`: number of
    /// rows of the matrix.
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

    /// Adds P^T c c^T P, where c c^T is the contribution of an F-bar patch (tetrahedra e that share one volumetric
    /// strain) to A. The three components of the vector c at node j are c_j = sqrt((h^2 + h beta) lambda / V) sum_e V_e
    /// g_ej, with V_e the volumes of the tetrahedra, V their sum, g_ej the rest gradient of the node's shape function
    /// in tetrahedron e, and lambda the Lame parameter.
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

/// How a node moves with the modes of its block, in the axes of the body at rest.
#[derive(Debug, Clone)]
enum Basis {
    /// The weights 1, x, y, z in the velocity c0 + c1 x + c2 y + c3 z of a free node. The vectors c0 to c3 are the
    /// modes of its block; (x, y, z) is the node's place relative to the mean of the block's nodes, divided by the
    /// block's size.
    Affine([f64; 4]),
    /// The weights 1, x, y, z of a free node that supports hold, as in `Affine`, and the projection onto the directions
    /// in which the supports let the node move.
    Supported([f64; 4], DMat3),
    /// The matrix that maps w to the cross product w x r in the velocity v + w x r of a node attached to a core, where
    /// v and w are the core's linear and angular velocity and r is the node's place relative to the frame's centre.
    Twist(DMat3),
}

impl Basis {
    fn new(model: &Model, block: usize, node: u32, rigid: u32) -> Basis {
        if rigid == NONE {
            let weights = model.affine_weights(block, node);
            return match model.projection_of(node as usize) {
                Some(projection) => Basis::Supported(weights, projection),
                None => Basis::Affine(weights),
            };
        }
        Basis::twist(model, node)
    }

    fn twist(model: &Model, node: u32) -> Basis {
        let place = model.place_in_frame(node);
        Basis::Twist(DMat3::from_cols(DVec3::X.cross(place), DVec3::Y.cross(place), DVec3::Z.cross(place)))
    }

    /// The basis functions as 3x3 matrices, each of which maps three modes to a part of the node's velocity.
    fn matrices(&self) -> Vec<DMat3> {
        match self {
            Basis::Affine(weights) => weights.iter().map(|w| DMat3::from_diagonal(DVec3::splat(*w))).collect(),
            Basis::Supported(weights, projection) => weights.iter().map(|w| *projection * *w).collect(),
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
