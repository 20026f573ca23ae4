//! Linear static equilibrium of a layer (tetrahedral mesh), for tests against closed-form solutions; it is not part of
//! the step.

use glam::{DQuat, DVec3};
use palpate::Result;

use crate::elastic::{Elements, Weight, outer};
use crate::linear::{Entries, Solver};

/// Solves for the displacements (m, world axes) under `loads` (N on each node, world axes), at small strain about rest.
/// `fixed` marks components of nodes that are held at zero. Returns an error if the fixed components do not prevent
/// rigid motion.
pub fn solve(elements: &Elements, fixed: &[[bool; 3]], loads: &[DVec3]) -> Result<Vec<DVec3>> {
    let mut unknowns = vec![[None; 3]; elements.node_count()];
    let mut count = 0;
    for (unknown, held) in unknowns.iter_mut().zip(fixed) {
        for axis in (0..3).filter(|&axis| !held[axis]) {
            unknown[axis] = Some(count);
            count += 1;
        }
    }
    let mut a = Entries::default();
    for (e, nodes) in elements.tetrahedra.iter().enumerate() {
        let blocks = elements.stiffness_blocks(e, DQuat::IDENTITY, Weight::both(1.0));
        for (k, i) in nodes.iter().enumerate() {
            for (l, j) in nodes.iter().enumerate() {
                add_block(&mut a, unknowns[*i as usize], unknowns[*j as usize], &blocks[k][l]);
            }
        }
    }
    for row in elements.patch_rows(&vec![DQuat::IDENTITY; elements.tetrahedra.len()]) {
        for (i, left) in &row {
            for (j, right) in &row {
                add_block(&mut a, unknowns[*i as usize], unknowns[*j as usize], &outer(*left, *right));
            }
        }
    }
    let mut b = vec![0.0; count];
    each(&unknowns, |node, axis, unknown| b[unknown] = loads[node][axis]);
    let x = Solver::default().solve(&a, &b)?;
    let mut displacements = vec![DVec3::ZERO; unknowns.len()];
    each(&unknowns, |node, axis, unknown| displacements[node][axis] = x[unknown]);
    Ok(displacements)
}

fn add_block(a: &mut Entries, rows: [Option<usize>; 3], columns: [Option<usize>; 3], block: &glam::DMat3) {
    for (r, row) in rows.iter().enumerate() {
        for (c, column) in columns.iter().enumerate() {
            if let (Some(row), Some(column)) = (row, column) {
                a.add(*row, *column, block.col(c)[r]);
            }
        }
    }
}

fn each(unknowns: &[[Option<usize>; 3]], mut visit: impl FnMut(usize, usize, usize)) {
    for (node, axes) in unknowns.iter().enumerate() {
        for (axis, unknown) in axes.iter().enumerate() {
            if let Some(unknown) = unknown {
                visit(node, axis, *unknown);
            }
        }
    }
}
