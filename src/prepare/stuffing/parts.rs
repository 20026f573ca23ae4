//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a lattice.
//! This file mends the connectivity of the *filling* (all tetrahedra): it duplicates nodes at which tetrahedra touch by
//! a corner or an edge only, and removes small separate parts (*bits*). A *cut* is a point where a lattice edge leaves
//! the solid; a lattice node that was moved onto a cut is *warped*.

use std::collections::BTreeMap;

use glam::DVec3;

use super::cut::{Cuts, Side};
use super::fill::Filling;
use super::stencil::Corner;
use crate::prepare::NONE;
use crate::prepare::distance::Solid;
use crate::prepare::layer::FACES;
use crate::prepare::skin::{self, Sets};

/// Whether a corner of a tetrahedron lies on the surface, that is, is a warped node or a cut.
fn on_surface(cuts: &Cuts, corner: Corner) -> bool {
    match corner {
        Corner::Node(n) => cuts.side[n as usize] == Side::On,
        Corner::Cut(..) => true,
    }
}

/// Duplicates every surface node whose tetrahedra fall into groups that no shared face connects (a face in a gap of the
/// solid does not count as shared): each group gets a node of its own. Returns the number of nodes added.
pub(super) fn split(solid: &Solid, cuts: &Cuts, filling: &mut Filling) -> usize {
    let surface: Vec<bool> = filling.corners.iter().map(|&c| on_surface(cuts, c)).collect();
    let near: Vec<u32> = (0..filling.tetrahedra.len() as u32)
        .filter(|&t| filling.tetrahedra[t as usize].iter().any(|&n| surface[n as usize]))
        .collect();
    let mut wedges = joined_wedges(solid, filling, &surface, &near);
    let before = filling.nodes.len();
    let mut first = vec![NONE; before];
    let mut copies = BTreeMap::new();
    for wedge in 0..4 * near.len() as u32 {
        let (t, k) = (near[wedge as usize / 4] as usize, wedge as usize % 4);
        let n = filling.tetrahedra[t][k] as usize;
        let group = wedges.find(wedge);
        if !surface[n] || first[n] == group {
            continue;
        }
        if first[n] == NONE {
            first[n] = group;
            continue;
        }
        filling.tetrahedra[t][k] = *copies.entry(group).or_insert_with(|| {
            filling.nodes.push(filling.nodes[n]);
            filling.corners.push(filling.corners[n]);
            filling.nodes.len() as u32 - 1
        });
    }
    filling.nodes.len() - before
}

/// Joins *wedges* at each node of a face that two tetrahedra share. A wedge is a corner of one of the tetrahedra `near`
/// the surface; wedge 4 i + k is corner k of the i-th tetrahedron in `near`.
fn joined_wedges(solid: &Solid, filling: &Filling, surface: &[bool], near: &[u32]) -> Sets {
    let mut faces: Vec<([u32; 3], u32, u8)> = Vec::with_capacity(4 * near.len());
    for (local, &t) in near.iter().enumerate() {
        for (opposite, face) in FACES.iter().enumerate() {
            let mut key = face.map(|k| filling.tetrahedra[t as usize][k]);
            key.sort_unstable();
            faces.push((key, local as u32, opposite as u8));
        }
    }
    faces.sort_unstable();
    let mut wedges = Sets::new(4 * near.len());
    for pair in faces.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() == 2) {
        let [(face, s, opposite_s), (_, t, opposite_t)] = [pair[0], pair[1]];
        let [p, q] = [s, t].map(|local| filling.tetrahedra[near[local as usize] as usize]);
        // If nodes in the gap between two limbs (parts of the solid with a narrow gap between them) were warped, the
        // limbs may share a face there, although the solid does not connect them.
        let in_surface = face.iter().all(|&n| surface[n as usize]);
        let ends = [p[opposite_s as usize], q[opposite_t as usize]].map(|n| filling.nodes[n as usize]);
        if in_surface && leaves(solid, ends[0], ends[1]) {
            continue;
        }
        for n in face {
            let wedge = |t: [u32; 4], local: u32| t.iter().position(|&m| m == n).map(|k| 4 * local + k as u32);
            if let (Some(a), Some(b)) = (wedge(p, s), wedge(q, t)) {
                wedges.join(a, b);
            }
        }
    }
    wedges
}

/// Whether the segment from `a` to `b` leaves the solid; both points are inside.
fn leaves(solid: &Solid, a: DVec3, b: DVec3) -> bool {
    let hits = solid.hits(a, b);
    hits.windows(2).any(|pair| solid.signed(a.lerp(b, (pair[0] + pair[1]) / 2.0)) > 0.0)
}

/// A part that was removed: its number of tetrahedra, its volume (m^3) and the position of one of its nodes (m).
pub(super) struct Dropped {
    pub tetrahedra: usize,
    pub volume: f64,
    pub place: DVec3,
}

/// Keeps, for each connected piece of the surface, the largest part of the filling (by volume) that touches the piece;
/// removes all other parts. Two tetrahedra belong to one part if they are connected through shared nodes. Returns the
/// number of parts that stay, and the removed parts.
pub(super) fn drop_bits(
    solid: &Solid,
    (vertices, triangles): (&[DVec3], &[[u32; 3]]),
    cuts: &Cuts,
    filling: &mut Filling,
) -> (usize, Vec<Dropped>) {
    let mut sets = Sets::new(filling.nodes.len());
    for t in &filling.tetrahedra {
        (1..4).for_each(|k| sets.join(t[0], t[k]));
    }
    let (labels, count) = sets.labels();
    if count < 2 {
        return (count, Vec::new());
    }
    let mut bits: Vec<Dropped> =
        (0..count).map(|_| Dropped { tetrahedra: 0, volume: 0.0, place: DVec3::ZERO }).collect();
    for t in &filling.tetrahedra {
        let bit = &mut bits[labels[t[0] as usize] as usize];
        bit.tetrahedra += 1;
        bit.volume += crate::prepare::layer::volume6(&filling.nodes, t) / 6.0;
        bit.place = filling.nodes[t[0] as usize];
    }
    let (pieces, piece_count) = skin::parts(vertices.len(), triangles);
    let mut largest: Vec<Option<u32>> = vec![None; piece_count];
    // Only inside nodes tell which piece of the surface their part touches: the piece nearest to them. A node on the
    // surface may lie on the piece of a neighbouring part.
    let mut asked = vec![false; filling.nodes.len()];
    let touches = |t: &&[u32; 4]| t.iter().any(|&n| on_surface(cuts, filling.corners[n as usize]));
    for &n in filling.tetrahedra.iter().filter(touches).flatten() {
        if on_surface(cuts, filling.corners[n as usize]) || std::mem::replace(&mut asked[n as usize], true) {
            continue;
        }
        let label = labels[n as usize];
        let best = &mut largest[pieces[solid.nearest_vertex(filling.nodes[n as usize]) as usize] as usize];
        if best.is_none_or(|b| bits[label as usize].volume > bits[b as usize].volume) {
            *best = Some(label);
        }
    }
    let mut kept = vec![false; count];
    largest.into_iter().flatten().for_each(|label| kept[label as usize] = true);
    filling.tetrahedra.retain(|t| kept[labels[t[0] as usize] as usize]);
    compact(filling);
    let stay = kept.iter().filter(|&&k| k).count();
    (stay, bits.into_iter().zip(kept).filter(|b| !b.1).map(|b| b.0).collect())
}

/// Removes nodes that belong to no tetrahedron.
pub(super) fn compact(filling: &mut Filling) {
    let mut number = vec![NONE; filling.nodes.len()];
    filling.tetrahedra.iter().flatten().for_each(|&n| number[n as usize] = 0);
    for (next, slot) in number.iter_mut().filter(|slot| **slot == 0).enumerate() {
        *slot = next as u32;
    }
    let used = |n: usize| number[n] != NONE;
    let mut n = 0;
    filling.nodes.retain(|_| (used(n), n += 1).0);
    let mut n = 0;
    filling.corners.retain(|_| (used(n), n += 1).0);
    filling.tetrahedra.iter_mut().for_each(|t| *t = t.map(|n| number[n as usize]));
}
