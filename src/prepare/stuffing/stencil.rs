//! The part of one lattice tetrahedron that lies inside: the stencils of isosurface stuffing.
//!
//! A face with two inside corners and two cuts is a quadrilateral that two tetrahedra share; both must draw the same
//! diagonal. Where one cut is on the long edge, the diagonal ends at it; where both are on short edges, it starts at the
//! lesser or the greater of the inside nodes, by turns around their long edge, as the parity rule of the paper.

use super::cut::Side;
use crate::prepare::lattice::Lattice;

/// A corner of a piece: a lattice node, or the cut on the edge from an inside node to another.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(super) enum Corner {
    Node(u32),
    Cut(u32, u32),
}

use Corner::{Cut, Node};

/// A piece of a tetrahedron; its winding may be either.
pub(super) type Piece = [Corner; 4];

/// Splits of a triangular prism with sides `top[k]`-`bottom[k]`, by the order of its columns: the diagonal between two
/// columns goes from the top of the earlier one to the bottom of the later one.
fn prism(top: [Corner; 3], bottom: [Corner; 3], [x, y, z]: [usize; 3]) -> [Piece; 3] {
    [
        [top[x], top[y], top[z], bottom[z]],
        [top[x], top[y], bottom[y], bottom[z]],
        [top[x], bottom[x], bottom[y], bottom[z]],
    ]
}

/// Orders of three columns.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Whether the diagonal of the face of inside nodes `a`, `b` and outside node `d` goes from `a` to the cut on b-d, and
/// not from `b` to the cut on a-d.
fn from_first(lattice: &Lattice, a: u32, b: u32, d: u32) -> bool {
    if Lattice::is_long(a, d) {
        return false;
    }
    if Lattice::is_long(b, d) {
        return true;
    }
    // Going round the long edge a-b, the four nodes d alternate in the parity of the halves that are less than the
    // edge's middle: with the edge along one axis they differ by one step along one of the others.
    let (low, high) = (a.min(b), a.max(b));
    let (p, q, r) = (lattice.halves(low), lattice.halves(high), lattice.halves(d));
    let below = (0..3).filter(|&k| p[k] == q[k] && r[k] < p[k]).count();
    (below % 2 == 0) == (a == low)
}

/// Choices of pieces for a tetrahedron's inside part, each filling it: `side` holds the sides of its corners as seen from
/// the limb that is filled. One choice, but for two inside and two outside corners, where the quadrilateral on the
/// surface may be split either way.
pub(super) fn pieces(lattice: &Lattice, nodes: [u32; 4], side: [Side; 4]) -> Vec<Vec<Piece>> {
    let of = |wanted: Side| nodes.into_iter().zip(side).filter(move |s| s.1 == wanted).map(|s| s.0);
    let mut inside = [0; 4];
    let inside_count = of(Side::Inside).zip(&mut inside).map(|(n, slot)| *slot = n).count();
    let mut outside = [0; 4];
    let outside_count = of(Side::Outside).zip(&mut outside).map(|(n, slot)| *slot = n).count();
    let [a, b, c, _] = inside;
    let [d, e, ..] = outside;
    match (inside_count, outside_count) {
        (0, _) => Vec::new(),
        (_, 0) => vec![vec![nodes.map(Node)]],
        (1, _) => {
            let end = |k: usize| if side[k] == Side::Outside { Cut(a, nodes[k]) } else { Node(nodes[k]) };
            vec![vec![[0, 1, 2, 3].map(end)]]
        }
        (2, 1) => {
            let apex = of(Side::On).next().map_or(Node(a), Node);
            let (a, b) = if from_first(lattice, a, b, d) { (a, b) } else { (b, a) };
            vec![vec![[Node(a), Node(b), Cut(b, d), apex], [Node(a), Cut(b, d), Cut(a, d), apex]]]
        }
        (2, _) => {
            let (top, bottom) = ([Node(a), Cut(a, d), Cut(a, e)], [Node(b), Cut(b, d), Cut(b, e)]);
            let first = [d, e].map(|n| from_first(lattice, a, b, n));
            let fits = |order: &&[usize; 3]| {
                let place = |k| order.iter().position(|&c| c == k);
                (place(0) < place(1)) == first[0] && (place(0) < place(2)) == first[1]
            };
            ORDERS.iter().filter(fits).map(|&order| prism(top, bottom, order).to_vec()).collect()
        }
        (_, _) => {
            let inner = [a, b, c];
            let follows = |i: usize, j: usize| from_first(lattice, inner[i], inner[j], d);
            let fits = |[x, y, z]: &&[usize; 3]| follows(*x, *y) && follows(*x, *z) && follows(*y, *z);
            let cuts = inner.map(|n| Cut(n, d));
            let order = ORDERS.iter().find(fits);
            order.map(|&order| prism(inner.map(Node), cuts, order).to_vec()).into_iter().collect()
        }
    }
}
