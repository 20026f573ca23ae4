//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a
//! body-centred cubic lattice: makes larger tetrahedra deep inside the solid, by an octree over the lattice's cubic
//! cells. An *octant* of level l is a cube of 2^l cells along each side.
//!
//! As in the paper (F. Labelle and J. Shewchuk 2007), two octants of one size share four tetrahedra on their common
//! face; such a tetrahedron is bisected if a smaller octant touches its edge in the face. If four smaller octants lie
//! on a face of an octant, the larger octant gets eight tetrahedra there, and each smaller octant gets a pyramid, cut
//! into two halves. Octants larger than a cell stay away from the surface, so that the surface never cuts their
//! tetrahedra and their nodes are never moved onto it; these tetrahedra have dihedral angles of 35 degrees and more.

use super::sample::Field;
use crate::prepare::distance::Solid;
use crate::prepare::lattice::Lattice;

/// Least distance of an octant larger than a cell from the surface, in cell edges: the surface then does not cut the
/// octant's neighbours, and their nodes are not moved onto the surface.
const DEEP: f64 = 2.0;

/// Around an octant larger than a cell, this many shells of cells must be inside the solid. This is needed for surfaces
/// with holes, where the inside may end far from any triangle.
const RING: usize = 2;

/// Whether all nodes of an octant's cells and of [`RING`] shells of cells around the octant are inside the solid.
fn all_inside(lattice: &Lattice, field: &Field, low: [usize; 3], size: usize) -> bool {
    let cells = |k: usize| low[k] - RING..=low[k] + size + RING;
    cells(2).all(|z| {
        cells(1).all(|y| {
            cells(0).all(|x| {
                let node = 2 * lattice.place([x, y, z]);
                field.value[node] < 0.0 && field.value[node + 1] < 0.0
            })
        })
    })
}

/// For each cell, the level of the octant that contains the cell.
pub(super) struct Octants {
    level: Vec<u8>,
}

impl Octants {
    /// Makes octants with at most `grade` cells (1, 2, 4, ...) along each side. Octants that touch differ by at most
    /// one level.
    pub(super) fn new(solid: &Solid, lattice: &Lattice, field: &Field, grade: u32) -> Self {
        let mut octants = Octants { level: vec![0; lattice.size().iter().product()] };
        for level in 1..=grade.ilog2() as u8 {
            let found: Vec<[usize; 3]> = octants.candidates(solid, lattice, field, level);
            for low in found {
                octants.raise(lattice, low, level);
            }
        }
        octants
    }

    /// The places where an octant of the given level fits, each given by its cell with the lowest indices: the octant
    /// lies deep enough, and all cells in and around it belong to octants of at least the next lower level.
    fn candidates(&self, solid: &Solid, lattice: &Lattice, field: &Field, level: u8) -> Vec<[usize; 3]> {
        let (size, half) = (1 << level, 1 << (level - 1));
        let mut found = Vec::new();
        let counts = lattice.size().map(|n| n / size);
        for (z, y) in (0..counts[2]).flat_map(|z| (0..counts[1]).map(move |y| (z, y))) {
            for low in (0..counts[0]).map(|x| [x * size, y * size, z * size]) {
                let inner =
                    (0..3).all(|k| low[k] >= half.max(RING) && low[k] + size + half.max(RING) < lattice.size()[k]);
                let centre = lattice.at(low.map(|c| (2 * c + size) as i32));
                let need = lattice.cell() * (DEEP + size as f64 * 0.75f64.sqrt());
                let value = field.value[2 * lattice.place(low)];
                let deep = || value < 0.0 && solid.distance(centre) > need;
                if inner
                    && self.ring_reaches(lattice, low, level)
                    && deep()
                    && (field.clean || all_inside(lattice, field, low, size))
                {
                    found.push(low);
                }
            }
        }
        found
    }

    /// Whether all cells of the octant at `low`, and all cells within half its size around it, belong to octants of at
    /// least the next lower level.
    fn ring_reaches(&self, lattice: &Lattice, low: [usize; 3], level: u8) -> bool {
        let (size, half) = (1usize << level, 1usize << (level - 1));
        let steps = |k: usize| (low[k] - half..low[k] + size + half).step_by(half);
        steps(2).all(|z| steps(1).all(|y| steps(0).all(|x| self.level[lattice.place([x, y, z])] >= level - 1)))
    }

    fn raise(&mut self, lattice: &Lattice, low: [usize; 3], level: u8) {
        let size = 1 << level;
        for (z, y) in (0..size).flat_map(|z| (0..size).map(move |y| (z, y))) {
            let first = lattice.place([low[0], low[1] + y, low[2] + z]);
            self.level[first..first + size].fill(level);
        }
    }

    /// Calls `f` with the nodes of every tetrahedron on the faces of octants (a cell is an octant of level 0). The
    /// tetrahedra's volumes may have either sign.
    pub(super) fn each(&self, lattice: &Lattice, mut f: impl FnMut([u32; 4])) {
        let faces = Faces { lattice, level: &self.level };
        lattice.each_cell(|cell| faces.each(cell, &mut f));
    }
}

/// Makes the tetrahedra on the faces of octants.
struct Faces<'a> {
    lattice: &'a Lattice,
    level: &'a [u8],
}

impl Faces<'_> {
    fn each(&self, cell: [usize; 3], f: &mut impl FnMut([u32; 4])) {
        let level = self.level[self.lattice.place(cell)];
        if cell.iter().any(|c| c % (1 << level) != 0) {
            return;
        }
        for axis in 0..3 {
            if cell[axis] > 0 {
                let mut below = cell;
                below[axis] -= 1;
                if level == 0 && self.level[self.lattice.place(below)] == 0 {
                    self.lattice.on_face(cell, axis).for_each(&mut *f);
                } else {
                    self.face(cell, level, axis, false, f);
                }
            }
            if level > 0 || self.level_above(cell, axis) > 0 {
                self.face(cell, level, axis, true, f);
            }
        }
    }

    /// Level of the octant of the next cell along an axis; 0 beyond the lattice.
    fn level_above(&self, mut cell: [usize; 3], axis: usize) -> u8 {
        cell[axis] += 1;
        if cell[axis] < self.lattice.size()[axis] { self.level[self.lattice.place(cell)] } else { 0 }
    }

    /// Calls `f` with the tetrahedra of the octant at `cell` on its low or high face along `axis`. Tetrahedra that two
    /// octants of one size share are made only once, for the octant on the high side of the common face.
    fn face(&self, cell: [usize; 3], level: u8, axis: usize, high: bool, f: &mut impl FnMut([u32; 4])) {
        let size = 1usize << level;
        let mut beyond = cell;
        beyond[axis] = if high { cell[axis] + size } else { cell[axis] - 1 };
        let other = self.level[self.lattice.place(beyond)];
        if high && other == level {
            return;
        }
        let corner = cell.map(|c| 2 * c as i32);
        let width = 2 * size as i32;
        let centre = corner.map(|c| c + size as i32);
        let mut base = corner;
        base[axis] += if high { width } else { 0 };
        if other > level {
            return self.half_pyramids(centre, base, width, axis, f);
        }
        // The four corners of the face, in order around it.
        let at = |u: i32, v: i32| {
            let mut p = base;
            p[(axis + 1) % 3] += u;
            p[(axis + 2) % 3] += v;
            p
        };
        let ring = [at(0, 0), at(width, 0), at(width, width), at(0, width)];
        let apex = if other == level {
            let mut opposite = centre;
            opposite[axis] -= width;
            opposite
        } else {
            at(width / 2, width / 2)
        };
        for k in 0..4 {
            let (p, q) = (ring[k], ring[(k + 1) % 4]);
            let middle = [0, 1, 2].map(|i| (p[i] + q[i]) / 2);
            if other < level || self.is_split(middle, level) {
                self.give([centre, apex, p, middle], f);
                self.give([centre, apex, middle, q], f);
            } else {
                self.give([centre, apex, p, q], f);
            }
        }
    }

    /// Calls `f` with the two tetrahedra between the centre of a small octant and its face on a larger octant. The
    /// larger octant's face is split by lines from the middle of that face to the face's corners.
    fn half_pyramids(&self, centre: [i32; 3], base: [i32; 3], width: i32, axis: usize, f: &mut impl FnMut([u32; 4])) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // The corner `p` of the small face is also a corner of the larger octant if both its coordinates in the face
        // are multiples of the larger octant's width.
        let is_corner = |p: &[i32; 3]| p[u] % (2 * width) == 0 && p[v] % (2 * width) == 0;
        let at = |i: i32, j: i32| {
            let mut p = base;
            p[u] += i * width;
            p[v] += j * width;
            p
        };
        let ring = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
        if let Some(k) = ring.iter().position(is_corner) {
            let [p, q, r, s] = [0, 1, 2, 3].map(|i| ring[(k + i) % 4]);
            self.give([centre, p, q, r], f);
            self.give([centre, p, r, s], f);
        }
    }

    /// Whether the midpoint of an edge of an octant of this level is a corner of a smaller octant.
    fn is_split(&self, middle: [i32; 3], level: u8) -> bool {
        (0..8).any(|k: usize| {
            let cell = [0, 1, 2].map(|i| (middle[i] / 2 - (k >> i & 1) as i32) as usize);
            self.level[self.lattice.place(cell)] < level
        })
    }

    /// Calls `f` with the nodes of a tetrahedron given by positions in half cells, if the lattice has all four nodes.
    fn give(&self, places: [[i32; 3]; 4], f: &mut impl FnMut([u32; 4])) {
        let nodes = places.map(|p| self.lattice.node(p));
        if let [Some(a), Some(b), Some(c), Some(d)] = nodes {
            f([a, b, c, d]);
        }
    }
}
