//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a lattice.
//! A *cut* is a point where a lattice edge leaves the solid. This file collects the *pieces* (tetrahedra that fill the
//! inside part of one lattice tetrahedron) of all lattice tetrahedra, numbers their corners, and orders the corners so
//! that all volumes are positive.

use std::collections::HashMap;

use glam::DVec3;

use super::cut::{Cuts, Side};
use super::grade::Octants;
use super::stencil::{Corner, Piece, pieces};
use crate::prepare::lattice::Lattice;
use crate::prepare::quality::dihedral;

/// A filling: tetrahedra, their nodes' positions (m), and the lattice node or cut that each node stands for.
pub(super) struct Filling {
    pub corners: Vec<Corner>,
    pub nodes: Vec<DVec3>,
    pub tetrahedra: Vec<[u32; 4]>,
}

/// Fills the solid with tetrahedra; their nodes are numbered in the order of the lattice nodes. If several *limbs*
/// (parts of the solid with a narrow gap between them) meet in a lattice tetrahedron, they are filled one by one.
pub(super) fn fill(lattice: &Lattice, octants: &Octants, cuts: &Cuts) -> Filling {
    let place = |corner: Corner| match corner {
        Corner::Node(n) => cuts.warped.get(&n).copied().unwrap_or_else(|| lattice.position(n)),
        Corner::Cut(p, q) => lattice.position(p).lerp(lattice.position(q), cuts.share(p, q)),
    };
    let mut found: Vec<Piece> = Vec::new();
    octants.each(lattice, |nodes| {
        let side = nodes.map(|n| cuts.side[n as usize]);
        for side in limbs(cuts, nodes, side) {
            let choices = pieces(lattice, nodes, side);
            // Of several choices, the one whose angles keep farthest from 0 and 180 degrees is taken.
            let best = if choices.len() < 2 {
                choices.into_iter().next()
            } else {
                choices.into_iter().map(|c| (worst(&c, place), c)).max_by(|a, b| a.0.total_cmp(&b.0)).map(|c| c.1)
            };
            found.extend(best.into_iter().flatten());
        }
    });
    number(found, place)
}

/// How near the dihedral angles of some pieces come to 0 or 180 degrees (least difference, degrees); more is better.
fn worst(pieces: &[Piece], place: impl Fn(Corner) -> DVec3) -> f64 {
    let of = |piece: &Piece| {
        let (least, largest) = dihedral(piece.map(&place));
        least.min(180.0 - largest)
    };
    pieces.iter().map(of).fold(f64::INFINITY, f64::min)
}

/// For each limb in a lattice tetrahedron, the sides (inside, on the surface, outside) of the four nodes as seen from
/// this limb: inside nodes of another limb count as outside, and so do nodes on the surface that no edge connects to
/// the limb.
fn limbs(cuts: &Cuts, nodes: [u32; 4], side: [Side; 4]) -> Vec<[Side; 4]> {
    let inside = |k: &usize| side[*k] == Side::Inside;
    if (0..4).all(|k| !inside(&k)) {
        return Vec::new();
    }
    let joined = |i: usize, j: usize| cuts.joined(nodes[i], nodes[j]);
    if cuts.apart.is_empty() || (0..4).all(|j| (0..j).all(|i| joined(i, j))) {
        return vec![side];
    }
    let mut limbs = Vec::new();
    for first in (0..4).filter(inside) {
        // Connection is transitive among inside nodes, so that the first node of a limb can represent the limb.
        if (0..first).filter(inside).any(|k| joined(k, first)) {
            continue;
        }
        limbs.push([0, 1, 2, 3].map(|k| match side[k] {
            Side::Inside | Side::On if k != first && !joined(first, k) => Side::Outside,
            other => other,
        }));
    }
    limbs
}

/// Numbers the corners of the pieces in the order of the lattice nodes: each node is followed by the cuts on its edges.
/// `place` gives the position of a corner, m.
fn number(pieces: Vec<Piece>, place: impl Fn(Corner) -> DVec3) -> Filling {
    let mut corners: Vec<Corner> = Vec::new();
    let mut seen: HashMap<Corner, u32> = HashMap::new();
    let mut tetrahedra: Vec<[u32; 4]> = Vec::with_capacity(pieces.len());
    for piece in pieces {
        tetrahedra.push(piece.map(|corner| {
            *seen.entry(corner).or_insert_with(|| {
                corners.push(corner);
                corners.len() as u32 - 1
            })
        }));
    }
    let key = |corner: &Corner| match *corner {
        Corner::Node(n) => (n, 0, 0),
        Corner::Cut(p, q) => (p, 1, q),
    };
    let mut order: Vec<u32> = (0..corners.len() as u32).collect();
    order.sort_unstable_by_key(|&i| key(&corners[i as usize]));
    let mut number = vec![0; corners.len()];
    order.iter().enumerate().for_each(|(new, &old)| number[old as usize] = new as u32);
    let corners: Vec<Corner> = order.iter().map(|&i| corners[i as usize]).collect();
    let nodes: Vec<DVec3> = corners.iter().map(|&c| place(c)).collect();
    for t in &mut tetrahedra {
        *t = t.map(|n| number[n as usize]);
        if crate::prepare::layer::volume6(&nodes, t) < 0.0 {
            t.swap(2, 3);
        }
    }
    Filling { corners, nodes, tetrahedra }
}
