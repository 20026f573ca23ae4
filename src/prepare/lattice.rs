//! The body-centred cubic background lattice for marching tetrahedra (`model/extract.rs`) and isosurface stuffing
//! (`stuffing`).
//!
//! The lattice's nodes are the corners and the centres of cubic cells. Every face between two cells carries four
//! tetrahedra, one for each edge of the face: the tetrahedron's nodes are the edge's two corners and the centres of the
//! two cells. All tetrahedra have the same shape, with dihedral angles of 60 and 90 degrees and volume `cell`^3 / 12.
//! An edge of a tetrahedron is *long* (one cell edge, between two corners or two centres) or *short* (half a cell's
//! space diagonal, between a corner and a centre).

use glam::DVec3;

/// Least distance between a side of the box that the lattice surrounds and a plane of lattice nodes, in cell edges: if
/// a flat side of a body lay in such a plane, rounding would decide which nodes are inside the body.
const CLEARANCE: f64 = 0.05;

/// The background lattice: `size` cells along the axes from the corner `origin`.
pub(super) struct Lattice {
    origin: DVec3,
    cell: f64,
    size: [usize; 3],
}

impl Lattice {
    /// A lattice around the box with the least corner `low` and the size `extent` (m). More than one spare cell lies
    /// beyond each side of the box, because the outermost cells lack some of their tetrahedra.
    pub(super) fn around(low: DVec3, extent: DVec3, cell: f64) -> Self {
        let (mut origin, mut size) = (low, [0; 3]);
        for k in 0..3 {
            let cells = extent[k] / cell;
            size[k] = cells.ceil() as usize + 3;
            let mut overhang = (size[k] as f64 - cells) / 2.0;
            let from_half = (2.0 * overhang).round() / 2.0 - overhang;
            if from_half.abs() < CLEARANCE {
                overhang += from_half + 2.0 * CLEARANCE;
            }
            origin[k] = low[k] - overhang * cell;
        }
        Lattice { origin, cell, size }
    }

    /// Edge of a cell, m.
    pub(super) fn cell(&self) -> f64 {
        self.cell
    }

    /// Number of cells along each axis.
    pub(super) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Number of nodes, used or not.
    pub(super) fn node_count(&self) -> usize {
        2 * self.size.iter().product::<usize>()
    }

    /// Indices of the cell that contains a point, which must lie well within the lattice.
    pub(super) fn cell_at(&self, point: DVec3) -> [usize; 3] {
        ((point - self.origin) / self.cell).to_array().map(|c| c as usize)
    }

    /// Position of a node, m.
    pub(super) fn position(&self, node: u32) -> DVec3 {
        self.at(self.halves(node))
    }

    /// Position (m) of a point that is given in half cell edges from the lattice's origin.
    pub(super) fn at(&self, halves: [i32; 3]) -> DVec3 {
        self.origin + self.cell * (DVec3::from_array(halves.map(f64::from)) * 0.5)
    }

    /// Index of a cell; cells are numbered with x fastest, then y, then z. The cell's low corner is the node with twice
    /// this index; the cell's centre is the next node.
    pub(super) fn place(&self, c: [usize; 3]) -> usize {
        c[0] + self.size[0] * (c[1] + self.size[1] * c[2])
    }

    /// Position of a node in half cell edges from the origin: three even numbers for a corner, three odd numbers for a
    /// centre.
    pub(super) fn halves(&self, node: u32) -> [i32; 3] {
        let cell = node as usize / 2;
        let (x, yz) = (cell % self.size[0], cell / self.size[0]);
        [x, yz % self.size[1], yz / self.size[1]].map(|c| 2 * c as i32 + node as i32 % 2)
    }

    /// The node at a position in half cell edges from the origin; `None` if the position lies beyond the lattice.
    pub(super) fn node(&self, halves: [i32; 3]) -> Option<u32> {
        let within = (0..3).all(|k| halves[k] >= 0 && halves[k] < 2 * self.size[k] as i32);
        within.then(|| 2 * self.place(halves.map(|h| h as usize / 2)) as u32 + (halves[0] & 1) as u32)
    }

    /// The neighbours of a node: six at the ends of long edges, then eight at the ends of short edges; fewer at the
    /// lattice's border.
    pub(super) fn neighbours(&self, node: u32) -> impl Iterator<Item = u32> {
        let [x, y, z] = self.halves(node);
        let long = [[2, 0, 0], [-2, 0, 0], [0, 2, 0], [0, -2, 0], [0, 0, 2], [0, 0, -2]].into_iter();
        let short = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2].map(|bit| 2 * bit - 1));
        long.chain(short).filter_map(move |[i, j, k]| self.node([x + i, y + j, z + k]))
    }

    /// Whether the edge between two neighbours is long.
    pub(super) fn is_long(a: u32, b: u32) -> bool {
        a % 2 == b % 2
    }

    /// Nodes of tetrahedron `e` (0 to 3) on the low face of a cell along `axis`: the centres of the two cells that
    /// share the face, then the two corners of edge `e` of the face. So the tetrahedron's edges 0-1 and 2-3 are long.
    fn nodes(&self, cell: [usize; 3], axis: usize, e: usize) -> [u32; 4] {
        const CORNERS: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let mut below = cell;
        below[axis] -= 1;
        let corner = |q: usize| {
            let mut c = cell;
            c[(axis + 1) % 3] += CORNERS[q][0];
            c[(axis + 2) % 3] += CORNERS[q][1];
            2 * self.place(c) as u32
        };
        let centre = |c| 2 * self.place(c) as u32 + 1;
        [centre(below), centre(cell), corner(e), corner((e + 1) % 4)]
    }

    /// Whether the low face of a cell along `axis` has a cell on both sides, and all corners of the face are nodes.
    fn has_face(&self, cell: [usize; 3], axis: usize) -> bool {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        cell[axis] > 0 && cell[u] + 1 < self.size[u] && cell[v] + 1 < self.size[v]
    }

    /// The four tetrahedra on the low face of a cell along `axis`; none if the lattice lacks their nodes.
    pub(super) fn on_face(&self, cell: [usize; 3], axis: usize) -> impl Iterator<Item = [u32; 4]> {
        let count = if self.has_face(cell, axis) { 4 } else { 0 };
        (0..count).map(move |e| self.nodes(cell, axis, e))
    }

    /// Calls `f` with every cell, x fastest.
    pub(super) fn each_cell(&self, mut f: impl FnMut([usize; 3])) {
        for z in 0..self.size[2] {
            for y in 0..self.size[1] {
                (0..self.size[0]).for_each(|x| f([x, y, z]));
            }
        }
    }

    /// Calls `f` with the nodes of every tetrahedron, in an order that gives the tetrahedron a positive volume.
    #[cfg(test)]
    pub(super) fn each(&self, mut f: impl FnMut([u32; 4])) {
        self.each_cell(|cell| (0..3).for_each(|axis| self.on_face(cell, axis).for_each(&mut f)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::layer::volume6;

    #[test]
    fn tetrahedra_are_equal_their_edges_are_the_neighbours_and_nodes_come_back_from_their_places() {
        let lattice = Lattice::around(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 0.7, 0.4), 0.25);
        let nodes: Vec<DVec3> = (0..lattice.node_count() as u32).map(|n| lattice.position(n)).collect();
        assert!((0..lattice.node_count() as u32).all(|n| lattice.node(lattice.halves(n)) == Some(n)));
        let mut count = 0;
        lattice.each(|t| {
            count += 1;
            assert!((volume6(&nodes, &t) - 0.5 * 0.25f64.powi(3)).abs() < 1e-12);
            assert!(Lattice::is_long(t[0], t[1]) && Lattice::is_long(t[2], t[3]) && !Lattice::is_long(t[1], t[2]));
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                assert!(lattice.neighbours(t[i]).any(|n| n == t[j]));
            }
        });
        assert!(count > 12 * 4 * 2);
    }

    #[test]
    fn sides_of_a_box_keep_clear_of_lattice_planes() {
        for cells in [3.0, 3.5, 3.98, 4.01] {
            let lattice = Lattice::around(DVec3::ZERO, DVec3::splat(cells), 1.0);
            for side in [0.0, cells] {
                let halves = 2.0 * (side - lattice.at([0; 3]).x);
                assert!(
                    (halves - halves.round()).abs() > 0.9 * CLEARANCE,
                    "box of {cells} cells: a side lies at {halves} half cells, too near a lattice plane"
                );
            }
        }
    }
}
