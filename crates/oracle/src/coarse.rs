//! The coarse space of the solver's two-level additive Schwarz preconditioner, with dense f64 matrices: the modes P
//! (basis of the coarse space) of aggregates (blocks of nodes), the Galerkin matrix P^T A P with the matrix A of a
//! step's system, and the coarse correction.

use std::collections::BTreeSet;

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};

use super::linear::Entries;
use super::step::Simulation;

/// Number of modes of a block, that is of its columns of P. Free nodes have four functions (a constant and the
/// coordinates x, y and z), each along three axes; a rigid core has its linear and its angular motion, and its other
/// columns are zero.
pub const BLOCK_UNKNOWNS: usize = 12;

/// Least eigenvalue of P^T P, relative to the largest, at which a combination of modes counts as independent.
const LEAST: f64 = 1e-9;

/// An aggregate: a block of nodes that move together in the coarse space.
#[derive(Debug, Clone)]
pub struct Block {
    /// Index of the nodes' body in the simulation.
    pub body: usize,
    /// Indices of the nodes within the body.
    pub nodes: Vec<u32>,
    /// The rigid core to which the nodes are attached; `None`: they are free.
    pub core: Option<usize>,
    /// Rotation of the modes from rest axes to world axes.
    pub turn: DQuat,
}

/// The matrix P of modes, with a row for each unknown and a column for each mode. A free node moves as
/// R (c0 + c1 x + c2 y + c3 z), with the block's rotation R and mode coefficients c0 to c3 (vectors); (x, y, z) is the
/// node's rest position relative to the middle of its block, divided by the greatest distance of a node of the block
/// from the middle. A rigid core has one set of modes, in the columns of its first block: its linear and angular
/// velocity along the axes of R.
pub fn prolongation(simulation: &Simulation, blocks: &[Block]) -> Mat<f64> {
    let unknowns = simulation.unknowns();
    let mut p = Mat::zeros(unknowns.count, BLOCK_UNKNOWNS * blocks.len());
    let mut seen = BTreeSet::new();
    for (b, block) in blocks.iter().enumerate() {
        let turn = DMat3::from_quat(block.turn.normalize());
        if let Some(core) = block.core {
            let (first, (linear, angular)) = (unknowns.cores[core], simulation.cores[core].freedom());
            if seen.insert(core) {
                set(&mut p, first, BLOCK_UNKNOWNS * b, &(linear * turn));
                set(&mut p, first + 3, BLOCK_UNKNOWNS * b + 3, &(angular * turn));
            }
            continue;
        }
        let places = || block.nodes.iter().map(|n| simulation.bodies[block.body].layer.nodes[*n as usize]);
        let middle = places().sum::<DVec3>() / block.nodes.len() as f64;
        let size = places().map(|x| x.distance(middle)).fold(0.0, f64::max);
        for (node, place) in block.nodes.iter().zip(places()) {
            let at = if size > 0.0 { (place - middle) / size } else { DVec3::ZERO };
            for (first, _) in &unknowns.nodes[block.body][*node as usize] {
                for (k, weight) in [1.0, at.x, at.y, at.z].into_iter().enumerate() {
                    set(&mut p, *first, BLOCK_UNKNOWNS * b + 3 * k, &(weight * turn));
                }
            }
        }
    }
    p
}

fn set(matrix: &mut Mat<f64>, row: usize, column: usize, block: &DMat3) {
    for i in 0..3 {
        for j in 0..3 {
            matrix[(row + i, column + j)] = block.col(j)[i];
        }
    }
}

/// The Galerkin matrix P^T A P.
pub fn matrix(a: &Entries, p: &Mat<f64>) -> Mat<f64> {
    let mut operator_product = Mat::zeros(p.nrows(), p.ncols());
    for j in 0..p.ncols() {
        let column: Vec<f64> = (0..p.nrows()).map(|i| p[(i, j)]).collect();
        a.multiply(&column).into_iter().enumerate().for_each(|(i, x)| operator_product[(i, j)] = x);
    }
    p.transpose() * operator_product
}

/// The coarse correction Q (Q^T A Q)^-1 Q^T, where the columns of Q are an orthonormal basis of the range of P (the
/// columns of P may depend on each other); `None` where Q^T A Q is not positive definite.
pub fn correction(a: &Entries, p: &Mat<f64>) -> Option<Mat<f64>> {
    let eigen = (p.transpose() * p).self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S(), eigen.U());
    let largest = (0..p.ncols()).map(|k| values[k]).fold(0.0, f64::max);
    let own: Vec<usize> = (0..p.ncols()).filter(|k| values[*k] > LEAST * largest).collect();
    let turned = Mat::from_fn(p.ncols(), own.len(), |i, k| vectors[(i, own[k])] / values[own[k]].sqrt());
    let q = p * turned;
    let factor = matrix(a, &q).llt(Side::Lower).ok()?;
    let inverse = faer::linalg::solvers::DenseSolveCore::inverse(&factor);
    Some(&q * inverse * q.transpose())
}
