//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a
//! body-centred cubic lattice. This file treats features of the surface that are thinner than a lattice cell: lattice
//! nodes outside the solid are *taken in* (count as inside), so that no feature becomes separate and no part of the
//! surface is left without a tetrahedron near it. A lattice node is *filled* if it is a node of tetrahedra that fill
//! the solid.
//!
//! The Voronoi cells of the lattice's nodes are truncated octahedra with a circumradius of 0.56 cell edges. A feature's
//! axis passes through a sequence of neighbouring Voronoi cells; the nodes of these cells form a *chain* that lies
//! within 0.56 cell edges of the axis. The nodes of the cheapest chains from filled nodes to vertices of the surface
//! that have no filled node nearby, and to separate parts of the solid, are taken in. E. Dijkstra's algorithm (1959)
//! finds these chains; edges outside the solid cost more than edges inside.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::cut::{Cuts, Side};
use super::sample::Field;
use crate::prepare::NONE;
use crate::prepare::distance::Solid;
use crate::prepare::lattice::Lattice;
use crate::prepare::skin::{self, Sets};

/// A vertex of the surface lies on a lost feature if there is no filled node within this many cell edges. A vertex of a
/// flat surface always has a filled node within 0.9 cell edges.
const LOST: f64 = 1.0;
/// No chain contains a node that lies farther outside the solid than this many cell edges.
const FAR: f64 = 0.8;
/// The cost of an edge is its length, in cell edges, times (1 + `PRICE` d), where d is the distance, in cell edges, by
/// which the edge's end lies outside the solid.
const PRICE: f64 = 16.0;

/// The *parts* (limbs) of the solid: sets of inside nodes that are connected by lattice edges within the solid.
struct Limbs<'a> {
    lattice: &'a Lattice,
    field: &'a Field,
    cuts: &'a Cuts,
    /// Part of each inside node.
    label: Vec<u32>,
    /// For each part, whether it stays in the filling: at each connected piece of the surface the largest part stays.
    kept: Vec<bool>,
}

/// The outside nodes to be taken in, the farthest from the surface first.
pub(super) fn taken_in(
    solid: &Solid,
    (vertices, triangles): (&[DVec3], &[[u32; 3]]),
    lattice: &Lattice,
    field: &Field,
    cuts: &Cuts,
) -> Vec<u32> {
    let (pieces, piece_count) = skin::parts(vertices.len(), triangles);
    let limbs = Limbs::new(solid, lattice, field, cuts, &pieces, piece_count);
    let mut taken = vec![false; field.value.len()];
    let mut used = vec![false; vertices.len()];
    triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    // If a piece of the surface has no part that stays, the node nearest to the piece's first vertex is taken in.
    let mut filled = vec![false; piece_count];
    limbs.pieces_filled(solid, &pieces, &mut filled);
    for v in (0..vertices.len()).filter(|&v| used[v]) {
        if !std::mem::replace(&mut filled[pieces[v] as usize], true) {
            limbs.nearest(vertices[v]).into_iter().for_each(|n| taken[n as usize] = true);
        }
    }
    let lost: Vec<usize> = (0..vertices.len()).filter(|&v| used[v] && !limbs.covers(vertices[v], &taken)).collect();
    let loose = limbs.loose();
    if !lost.is_empty() || !loose.is_empty() {
        let (way, from) = limbs.ways(&taken);
        for node in loose {
            take(node, &from, &mut taken);
        }
        let end = |v: &usize| limbs.nearest(vertices[*v]);
        let mut ends: Vec<(f64, usize, u32)> =
            lost.iter().filter_map(|v| end(v).map(|n| (way[n as usize], *v, n))).collect();
        // The vertices with the costliest chains come first, because their chains also serve nearer vertices.
        ends.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, v, node) in ends {
            if !limbs.covers(vertices[v], &taken) {
                take(node, &from, &mut taken);
            }
        }
    }
    let outside = |n: &u32| taken[*n as usize] && cuts.side[*n as usize] != Side::Inside;
    let mut nodes: Vec<u32> = (0..taken.len() as u32).filter(outside).collect();
    nodes.sort_by(|&a, &b| field.value[b as usize].total_cmp(&field.value[a as usize]));
    nodes
}

/// Takes in the nodes of a chain, from the chain's end `node` to its start; `from` gives each node's previous node.
fn take(mut node: u32, from: &[u32], taken: &mut [bool]) {
    while node != NONE && !std::mem::replace(&mut taken[node as usize], true) {
        node = from[node as usize];
    }
}

impl<'a> Limbs<'a> {
    fn new(
        solid: &Solid,
        lattice: &'a Lattice,
        field: &'a Field,
        cuts: &'a Cuts,
        pieces: &[u32],
        piece_count: usize,
    ) -> Self {
        let inside = |n: u32| cuts.side[n as usize] == Side::Inside;
        let nodes = 0..field.value.len() as u32;
        let mut sets = Sets::new(field.value.len());
        for n in nodes.clone().filter(|&n| inside(n)) {
            for m in lattice.neighbours(n).filter(|&m| m > n && inside(m) && cuts.joined(n, m)) {
                sets.join(n, m);
            }
        }
        let (label, count) = sets.labels();
        let mut size = vec![0u32; count];
        nodes.clone().filter(|&n| inside(n)).for_each(|n| size[label[n as usize] as usize] += 1);
        let mut largest: Vec<Option<u32>> = vec![None; piece_count];
        let near = |n: &u32| inside(*n) && field.value[*n as usize].abs() < 1.5 * lattice.cell();
        for n in nodes.filter(near) {
            let piece = pieces[solid.nearest_vertex(lattice.position(n)) as usize] as usize;
            let mine = label[n as usize];
            if largest[piece].is_none_or(|b| size[mine as usize] > size[b as usize]) {
                largest[piece] = Some(mine);
            }
        }
        let mut kept = vec![false; count];
        largest.into_iter().flatten().for_each(|l| kept[l as usize] = true);
        Limbs { lattice, field, cuts, label, kept }
    }

    fn is_kept(&self, n: u32) -> bool {
        self.cuts.side[n as usize] == Side::Inside && self.kept[self.label[n as usize] as usize]
    }

    /// Marks in `filled` the pieces of the surface that touch a part which stays.
    fn pieces_filled(&self, solid: &Solid, pieces: &[u32], filled: &mut [bool]) {
        let near = |n: &u32| self.is_kept(*n) && self.field.value[*n as usize].abs() < 1.5 * self.lattice.cell();
        for n in (0..self.field.value.len() as u32).filter(near) {
            filled[pieces[solid.nearest_vertex(self.lattice.position(n)) as usize] as usize] = true;
        }
    }

    /// Nodes within `cells` cell edges of a point, and their distances from it, m.
    fn around(&self, point: DVec3, cells: f64) -> impl Iterator<Item = (u32, f64)> {
        let centre = ((point - self.lattice.at([0; 3])) * (2.0 / self.lattice.cell())).round();
        let reach = (2.0 * cells).ceil() as i32;
        let [x, y, z] = centre.to_array().map(|c| c as i32);
        let offsets = move || -reach..=reach;
        let all =
            offsets().flat_map(move |i| offsets().flat_map(move |j| offsets().map(move |k| [x + i, y + j, z + k])));
        let even = all.filter(|[i, j, k]| (i & 1) == (j & 1) && (j & 1) == (k & 1));
        let found = even.filter_map(|halves| self.lattice.node(halves));
        let farthest = cells * self.lattice.cell();
        found.map(move |n| (n, self.lattice.position(n).distance(point))).filter(move |f| f.1 <= farthest)
    }

    fn nearest(&self, point: DVec3) -> Option<u32> {
        self.around(point, 1.0).min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0))).map(|f| f.0)
    }

    /// Whether a point is near a filled node of a part that stays, or near a node that was taken in.
    fn covers(&self, point: DVec3, taken: &[bool]) -> bool {
        let holds = |(n, _): (u32, f64)| {
            let on = || self.cuts.side[n as usize] == Side::On;
            let held = || self.lattice.neighbours(n).any(|m| self.is_kept(m) && self.cuts.joined(n, m));
            taken[n as usize] || self.is_kept(n) || (on() && held())
        };
        // Most vertices have a filled node close by, so a small neighbourhood is tried first.
        self.around(point, 0.5).any(holds) || self.around(point, LOST).any(holds)
    }

    /// One node of each part that does not stay.
    fn loose(&self) -> Vec<u32> {
        let mut seen = self.kept.clone();
        let inside = |n: &u32| self.cuts.side[*n as usize] == Side::Inside;
        (0..self.label.len() as u32)
            .filter(inside)
            .filter(|&n| !std::mem::replace(&mut seen[self.label[n as usize] as usize], true))
            .collect()
    }

    /// For each node, the cost of the cheapest chain that leads to it from a part that stays or from a node in `seeds`,
    /// and the previous node of that chain.
    fn ways(&self, seeds: &[bool]) -> (Vec<f64>, Vec<u32>) {
        let count = self.field.value.len();
        let (mut way, mut from) = (vec![f64::INFINITY; count], vec![NONE; count]);
        let mut heap = BinaryHeap::new();
        let cell = self.lattice.cell();
        for n in (0..count as u32).filter(|&n| self.is_kept(n) || seeds[n as usize]) {
            way[n as usize] = 0.0;
            if self.field.value[n as usize].abs() < 2.0 * cell {
                heap.push(Reverse((0u64, n)));
            }
        }
        while let Some(Reverse((bits, n))) = heap.pop() {
            let at = f64::from_bits(bits);
            if at > way[n as usize] {
                continue;
            }
            for m in self.lattice.neighbours(n).filter(|&m| self.cuts.joined(n, m)) {
                let outside = self.field.value[m as usize].max(0.0) / cell;
                let length = if Lattice::is_long(n, m) { 1.0 } else { 0.75f64.sqrt() };
                let there = at + length * (1.0 + PRICE * outside);
                if outside < FAR && there < way[m as usize] {
                    (way[m as usize], from[m as usize]) = (there, n);
                    // Positive floating-point numbers are ordered as their bits are.
                    heap.push(Reverse((there.to_bits(), m)));
                }
            }
        }
        (way, from)
    }
}
