//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a
//! body-centred cubic lattice: finds the points where lattice edges leave the solid (the *cuts*), and warps the lattice
//! so that no cut is too near a node. A lattice edge is *long* (one edge of a cubic cell) or *short* (half a space
//! diagonal of a cell).
//!
//! A node is *warped*, that is, moved onto a cut and so onto the surface, if the cut is nearer to the node than the
//! share [`LONG`] of a long edge or [`SHORT`] of a short edge. The remaining cuts keep these distances from both ends
//! of their edges, and that alone bounds the angles of every stencil (the tetrahedra that fill the inside part of a
//! lattice tetrahedron). The surface is drawn at a *level*, a signed distance slightly off zero (negative distances are
//! inside). The method follows F. Labelle and J. Shewchuk 2007 ("the paper").
//!
//! An edge that leaves the solid between two inside nodes has two cuts, one for each end, and connects nothing: its
//! ends belong to different *limbs* (parts of the solid with a narrow gap between them), unless two other edges of a
//! lattice triangle connect these ends within the solid.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::sample::{Edge, Field, in_parallel};
use crate::prepare::distance::{HALF, Solid};
use crate::prepare::lattice::Lattice;

/// A node is warped onto a cut nearer than this share of a long edge. With this value and [`SHORT`], the smallest
/// dihedral angle that occurs in samples of all stencils, warps and cuts is 10.5 degrees, the best bound that was
/// found; the paper's values, 0.25 for long edges and 0.41 for short ones, give 9.2 degrees.
pub(super) const LONG: f64 = 0.28;
/// A node is warped onto a cut nearer than this share of a short edge.
pub(super) const SHORT: f64 = 0.40;
/// Tolerance of a cut's position, as a share of the length of its edge.
const PRECISION: f64 = 1e-3;
/// Greatest number of iterations in the search for a cut.
const STEPS: usize = 30;

/// Side of the surface on which a lattice node lies.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Inside,
    On,
    Outside,
}

/// The cuts of lattice edges and the sides of lattice nodes, after warping.
pub(super) struct Cuts {
    /// Side of each node.
    pub side: Vec<Side>,
    /// Outside nodes that count as inside because a thin feature needs them; they are never warped.
    pub taken: HashSet<u32>,
    /// New positions of the warped nodes, m.
    pub warped: HashMap<u32, DVec3>,
    /// For an inside node (first) and a neighbour: where the edge between them leaves the solid, as a share of the edge
    /// from the inside node.
    pub leave: HashMap<(u32, u32), f64>,
    /// Edges (lower node first) that leave the solid between inside or warped ends, and so connect nothing.
    pub apart: HashSet<(u32, u32)>,
    /// Edges (lower node first) that leave the solid, but whose ends are connected by the two other edges of a lattice
    /// triangle; each with the width of the gap, m.
    pub welded: Vec<([u32; 2], f64)>,
    /// Edges (lower node first) that pass through the solid between two outside ends, each with the width of the solid
    /// there, m. The tetrahedra cannot represent this part of the solid.
    pub lost: Vec<([u32; 2], f64)>,
}

impl Cuts {
    /// The position of the cut on the edge from the inside node `from`, as a share of the edge from that node, clamped
    /// to the range for which the angles are bounded.
    pub(super) fn share(&self, from: u32, to: u32) -> f64 {
        let least = threshold(from, to);
        self.leave.get(&(from, to)).map_or(0.5, |&t| t.clamp(least, 1.0 - least))
    }

    /// Whether two neighbouring nodes are connected by their edge.
    pub(super) fn joined(&self, a: u32, b: u32) -> bool {
        self.apart.is_empty() || !self.apart.contains(&(a.min(b), a.max(b)))
    }
}

/// Share of the edge from node `a` to node `b` within which a cut warps a node.
fn threshold(a: u32, b: u32) -> f64 {
    if Lattice::is_long(a, b) { LONG } else { SHORT }
}

/// Cuts and warps the lattice for the surface, moved outwards by `level` (m). The outside nodes `taken` count as
/// inside, because features thinner than a cell need them.
pub(super) fn cut(solid: &Solid, lattice: &Lattice, field: &Field, edges: &[Edge], level: f64, taken: &[u32]) -> Cuts {
    let side = |v: &f64| if *v < 0.0 { Side::Inside } else { Side::Outside };
    let mut cuts = Cuts {
        side: field.value.iter().map(side).collect(),
        taken: taken.iter().copied().collect(),
        warped: HashMap::new(),
        leave: HashMap::new(),
        apart: HashSet::new(),
        welded: Vec::new(),
        lost: Vec::new(),
    };
    let mut leaves: Vec<Leave> = vec![Leave::default(); edges.len()];
    in_parallel(&mut leaves, 256, |chunk, leaves| {
        for (leave, edge) in leaves.iter_mut().zip(&edges[256 * chunk..]) {
            *leave = Leave::of(solid, lattice, edge, level);
        }
    });
    taken.iter().for_each(|&n| cuts.side[n as usize] = Side::Inside);
    cuts.leave_taken(lattice, edges, &mut leaves, taken);
    for (edge, leave) in edges.iter().zip(&leaves) {
        let [a, b] = edge.nodes;
        if let Some(t) = leave.forth {
            cuts.leave.insert((a, b), t);
        }
        if let Some(t) = leave.back {
            cuts.leave.insert((b, a), t);
        }
        match [a, b].map(|n| cuts.side[n as usize]) {
            [Side::Outside, Side::Outside] if leave.changes > 1 => cuts.lost.push(([a, b], width(lattice, edge))),
            _ if leave.changes > 1 => drop(cuts.apart.insert((a, b))),
            _ => {}
        }
    }
    cuts.warp(lattice, edges, &leaves);
    cuts.join(lattice);
    let found = |nodes: [u32; 2]| edges.binary_search_by_key(&nodes, |e| e.nodes).ok().map(|i| &edges[i]);
    for (nodes, gap) in &mut cuts.welded {
        *gap = found(*nodes).map_or(0.0, |edge| width(lattice, edge));
    }
    cuts
}

/// Distance between the first and the last point at which an edge meets the surface, m.
fn width(lattice: &Lattice, edge: &Edge) -> f64 {
    let [a, b] = edge.nodes.map(|n| lattice.position(n));
    let (first, last) = (edge.hits.first().unwrap_or(&0.0), edge.hits.last().unwrap_or(&0.0));
    (last - first) * a.distance(b)
}

/// Where an edge leaves the solid, seen from its first node (`forth`) and from its second node (`back`), as a share of
/// the edge from the respective node; and how often successive samples of the signed distance along the edge lie on
/// different sides of the surface.
#[derive(Clone, Copy, Default)]
struct Leave {
    forth: Option<f64>,
    back: Option<f64>,
    changes: usize,
}

impl Leave {
    fn of(solid: &Solid, lattice: &Lattice, edge: &Edge, level: f64) -> Self {
        let inside: Vec<bool> = edge.samples.iter().map(|s| s.1 < 0.0).collect();
        let changes = inside.windows(2).filter(|w| w[0] != w[1]).count();
        let [a, b] = edge.nodes.map(|n| lattice.position(n));
        let between = |k: usize| {
            let (from, to) = (edge.samples[k], edge.samples[k + 1]);
            let hit = edge.hits.iter().copied().find(|h| (from.0..=to.0).contains(h));
            Search { solid, a, b, hit, level }.cut(from, to)
        };
        let first = inside.iter().position(|i| !i).filter(|&k| k > 0);
        let last = inside.iter().rposition(|i| !i).filter(|&k| k + 1 < inside.len());
        Leave { forth: first.map(|k| between(k - 1)), back: last.map(|k| 1.0 - between(k)), changes }
    }
}

/// The search for the point with the signed distance `level` on an edge from `a` to `b`, between two samples of the
/// signed distance along the edge.
struct Search<'a> {
    solid: &'a Solid,
    a: DVec3,
    b: DVec3,
    /// Where the edge meets the surface between the two samples, as a share of the edge; `None` if it does not.
    hit: Option<f64>,
    level: f64,
}

impl Search<'_> {
    /// The share of the edge at which the signed distance is the level, by regula falsi (Illinois variant). A sample is
    /// a share of the edge and the signed distance there (m). The sign of distances between the samples changes at the
    /// hit.
    fn cut(&self, from: (f64, f64), to: (f64, f64)) -> f64 {
        let value = |t: f64| {
            let at = self.a.lerp(self.b, t);
            let distance = self.solid.distance(at);
            let negative = match self.hit {
                Some(hit) => (if t < hit { from.1 } else { to.1 }) < 0.0,
                // Without a hit the edge goes through a hole, where the winding number passes one half without a
                // triangle.
                None => self.solid.winding(at) > HALF,
            };
            (if negative { -distance } else { distance }) - self.level
        };
        if let (Some(hit), true) = (self.hit, self.level == 0.0) {
            return hit;
        }
        // The samples are on different sides of the surface, but may be on the same side of the level. The cut is then
        // at the sample nearer to the level. This sample is the middle of a gap narrower than twice the level, or an
        // end of the edge; warping leaves the node at that end in place.
        let (inner, outer) = if from.1 < to.1 { (from, to) } else { (to, from) };
        if outer.1 <= self.level {
            return outer.0;
        }
        if inner.1 >= self.level {
            return inner.0;
        }
        let (mut p, mut q) = ((from.0, from.1 - self.level), (to.0, to.1 - self.level));
        let mut kept = 0;
        for _ in 0..STEPS {
            let t = (p.0 * q.1 - q.0 * p.1) / (q.1 - p.1);
            let v = value(t);
            let tiny = v.abs() < PRECISION * self.a.distance(self.b);
            if tiny || (q.0 - p.0) < PRECISION {
                return t;
            }
            if (v < 0.0) == (p.1 < 0.0) {
                p = (t, v);
                q.1 *= if kept == 1 { 0.5 } else { 1.0 };
                kept = 1;
            } else {
                q = (t, v);
                p.1 *= if kept == 2 { 0.5 } else { 1.0 };
                kept = 2;
            }
        }
        (p.0 + q.0) / 2.0
    }
}

impl Cuts {
    /// Sets the cuts on the edges of the outside nodes `taken`, which count as inside: an edge between two inside ends
    /// has no cut; any other edge is cut where it meets the surface for the last time, as seen from the taken node, but
    /// no nearer to that node than the share [`threshold`].
    fn leave_taken(&mut self, lattice: &Lattice, edges: &[Edge], leaves: &mut [Leave], taken: &[u32]) {
        for &n in taken {
            for m in lattice.neighbours(n) {
                let key = [n.min(m), n.max(m)];
                let known = edges.binary_search_by_key(&key, |e| e.nodes).ok();
                let both = self.side[m as usize] == Side::Inside;
                let mut leave = Leave::default();
                if !both {
                    let hits = known.map(|i| &edges[i].hits);
                    let first = hits.and_then(|h| h.first()).copied();
                    let last = hits.and_then(|h| h.last()).copied();
                    let past = if n < m { last } else { first.map(|t| 1.0 - t) };
                    let share = past.unwrap_or(0.0).max(threshold(n, m));
                    (leave.forth, leave.back) = if n < m { (Some(share), None) } else { (None, Some(share)) };
                    self.leave.insert((n, m), share);
                }
                if let Some(i) = known {
                    leaves[i] = leave;
                }
            }
        }
    }

    /// Warps every node that is too near a cut: moves it onto the nearest cut, in the order of the nodes. Edges to a
    /// node that was warped earlier have lost their cuts and are ignored.
    fn warp(&mut self, lattice: &Lattice, edges: &[Edge], leaves: &[Leave]) {
        // Each entry is a node, the position of a cut as a share of the edge from that node, and the edge's other node.
        // If an edge has only one cut, the cut is tested for both ends of the edge.
        let mut near: Vec<(u32, f64, u32)> = Vec::new();
        for (edge, leave) in edges.iter().zip(leaves) {
            let [a, b] = edge.nodes;
            let (forth, back) = match (leave.forth, leave.back) {
                (Some(t), None) => (Some(t), Some(1.0 - t)),
                (None, Some(t)) => (Some(1.0 - t), Some(t)),
                both => both,
            };
            near.extend(forth.filter(|&t| t < threshold(a, b)).map(|t| (a, t, b)));
            near.extend(back.filter(|&t| t < threshold(a, b)).map(|t| (b, t, a)));
        }
        near.retain(|n| !self.taken.contains(&n.0));
        near.sort_by_key(|n| n.0);
        for group in near.chunk_by(|m, n| m.0 == n.0) {
            let node = group[0].0;
            let at = lattice.position(node);
            let open = group.iter().filter(|n| self.side[n.2 as usize] != Side::On);
            let places = open.map(|&(_, t, other)| at.lerp(lattice.position(other), t));
            if let Some(place) = places.min_by(|p, q| p.distance_squared(at).total_cmp(&q.distance_squared(at))) {
                self.warped.insert(node, place);
                self.side[node as usize] = Side::On;
            }
        }
    }

    /// Connects the ends of an edge of `apart` again if the other two edges of a lattice triangle connect them through
    /// an inside node: otherwise two tetrahedra could disagree about a face that they share.
    pub(super) fn join(&mut self, lattice: &Lattice) {
        let side = &self.side;
        // Only edges with an inside end and no outside end can connect limbs: any other edge has a cut or lies in the
        // surface.
        self.apart.retain(|&(a, b)| {
            let ends = [a, b].map(|n| side[n as usize]);
            ends.contains(&Side::Inside) && !ends.contains(&Side::Outside)
        });
        let mut apart: Vec<(u32, u32)> = self.apart.iter().copied().collect();
        apart.sort_unstable();
        loop {
            let before = apart.len();
            apart.retain(|&(a, b)| {
                let around: Vec<u32> = lattice.neighbours(a).collect();
                let middle = lattice.neighbours(b).filter(|n| around.contains(n));
                let mut joining = middle.filter(|&n| self.side[n as usize] == Side::Inside);
                if !joining.any(|n| self.joined(n, a) && self.joined(n, b)) {
                    return true;
                }
                self.apart.remove(&(a, b));
                self.welded.push(([a, b], 0.0));
                false
            });
            if apart.len() == before {
                break;
            }
        }
    }
}
