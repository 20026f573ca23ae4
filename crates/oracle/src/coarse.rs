//! The coarse level of the solver's preconditioner, dense: what blocks of nodes can do as wholes, and what is best done
//! with that.

use std::collections::BTreeSet;

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};

use super::linear::Entries;
use super::step::Simulation;

/// Columns of a block: four parts (all of it, and along x, y and z) of three axes each; of a core linear and angular ones.
pub const MODES: usize = 12;

/// Least eigenvalue of P^T P, over the largest, of what counts as a motion of its own.
const LEAST: f64 = 1e-9;

/// Nodes that move as a whole.
#[derive(Debug, Clone)]
pub struct Block {
    /// Among the bodies.
    pub body: usize,
    /// Within the body.
    pub nodes: Vec<u32>,
    /// The core that carries them.
    pub core: Option<usize>,
    /// From rest axes to the world.
    pub turn: DQuat,
}

/// P, unknowns by modes: a free node moves as R (c0 + c1 x + c2 y + c3 z), with (x, y, z) its rest place about the middle of
/// its block over the greatest distance from that; a core by its twist in turned axes, which the first of its blocks has.
pub fn modes(simulation: &Simulation, blocks: &[Block]) -> Mat<f64> {
    let unknowns = simulation.unknowns();
    let mut p = Mat::zeros(unknowns.count, MODES * blocks.len());
    let mut seen = BTreeSet::new();
    for (b, block) in blocks.iter().enumerate() {
        let turn = DMat3::from_quat(block.turn.normalize());
        if let Some(core) = block.core {
            let (first, (linear, angular)) = (unknowns.cores[core], simulation.cores[core].freedom());
            if seen.insert(core) {
                set(&mut p, first, MODES * b, &(linear * turn));
                set(&mut p, first + 3, MODES * b + 3, &(angular * turn));
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
                    set(&mut p, *first, MODES * b + 3 * k, &(weight * turn));
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

/// P^T A P.
pub fn matrix(a: &Entries, p: &Mat<f64>) -> Mat<f64> {
    let mut image = Mat::zeros(p.nrows(), p.ncols());
    for j in 0..p.ncols() {
        let column: Vec<f64> = (0..p.nrows()).map(|i| p[(i, j)]).collect();
        a.multiply(&column).into_iter().enumerate().for_each(|(i, x)| image[(i, j)] = x);
    }
    p.transpose() * image
}

/// Q (Q^T A Q)^-1 Q^T with the columns of Q an orthonormal basis of what P can do, whatever columns of P depend on each
/// other; `None` where A is not positive definite there.
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
