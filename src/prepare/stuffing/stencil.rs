//! Stencils of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a
//! body-centred cubic lattice: a stencil splits the part of one lattice tetrahedron that lies inside the solid into
//! tetrahedra (*pieces*). If several *limbs* (parts of the solid with a narrow gap between them) meet in a lattice
//! tetrahedron, each limb is split by itself. A lattice edge is *long* (one edge of a cubic cell) or *short* (half a
//! space diagonal of a cell).
//!
//! If a face of a lattice tetrahedron has two inside corners and two *cuts* (points where its edges leave the solid),
//! its inside part is a quadrilateral. Two lattice tetrahedra share this quadrilateral, so both must split it by the
//! same diagonal. If one cut is on a long lattice edge, the diagonal ends at that cut. If both cuts are on short edges,
//! the diagonal starts at the inside node with the lower or the higher index, alternately around the long edge between
//! the inside nodes; this is the parity rule of F. Labelle and J. Shewchuk (2007).

use super::cut::Side;
use crate::prepare::lattice::Lattice;

/// A corner of a piece: a lattice node, or the cut on the edge from an inside node (first) to another node (second).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(super) enum Corner {
    Node(u32),
    Cut(u32, u32),
}

use Corner::{Cut, Node};

/// A tetrahedral piece; its volume may have either sign.
pub(super) type Piece = [Corner; 4];

/// Splits a triangular prism into three tetrahedra. The prism's columns are the edges from `top[k]` to `bottom[k]`. The
/// given order of the columns determines the diagonals: the diagonal between two columns goes from the top of the
/// earlier column to the bottom of the later column.
fn prism(top: [Corner; 3], bottom: [Corner; 3], [x, y, z]: [usize; 3]) -> [Piece; 3] {
    [
        [top[x], top[y], top[z], bottom[z]],
        [top[x], top[y], bottom[y], bottom[z]],
        [top[x], bottom[x], bottom[y], bottom[z]],
    ]
}

/// All orders of the three columns of a prism.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Direction of the diagonal on a face with inside nodes `a`, `b` and outside node `d`: true if the diagonal goes from
/// `a` to the cut on the edge b-d, false if it goes from `b` to the cut on the edge a-d.
fn from_first(lattice: &Lattice, a: u32, b: u32, d: u32) -> bool {
    if Lattice::is_long(a, d) {
        return false;
    }
    if Lattice::is_long(b, d) {
        return true;
    }
    // Four nodes d lie around the long edge a-b. Along each of the two axes across the edge, such a node lies half a
    // cell above or below the edge. The number of axes along which it lies below is alternately even and odd around the
    // edge.
    let (low, high) = (a.min(b), a.max(b));
    let (p, q, r) = (lattice.halves(low), lattice.halves(high), lattice.halves(d));
    let below = (0..3).filter(|&k| p[k] == q[k] && r[k] < p[k]).count();
    (below % 2 == 0) == (a == low)
}

/// The possible lists of pieces that fill the inside part of a lattice tetrahedron. `side` is the side of each node as
/// seen from the limb that is filled (nodes of other limbs count as outside). There is one list, except if two nodes
/// are inside and two outside: then the quadrilateral on the surface may be split by either diagonal.
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
