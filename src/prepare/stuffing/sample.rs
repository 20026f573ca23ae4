//! Part of isosurface stuffing, which fills a *solid* (the inside of a surface) with tetrahedra by means of a
//! body-centred cubic lattice: samples the signed distance from the surface at lattice nodes and along the lattice
//! edges near the surface. The samples are taken once; the level (signed distance at which the surface is drawn,
//! slightly off zero) is applied later, in `cut.rs`.

use std::sync::Mutex;

use glam::DVec3;

use crate::prepare::distance::{HALF, Solid};
use crate::prepare::lattice::Lattice;

/// Edge length, in cells, of the largest cube of cells (block) that is classified as inside or outside by a single
/// test.
const BLOCK: usize = 8;
/// A winding number that differs by this much from both 0 and 1 means that the surface is open, folded over or partly
/// oriented inwards: the numerical error of winding numbers is smaller.
const CLEAN: f64 = 0.2;

/// The stretch of an edge between two hits (points where the edge meets the surface) is ignored if its middle is nearer
/// to the surface than this share of its length. Such a stretch crosses a bulge or hollow that is shallow compared with
/// the cell; the bulge does not count as a part of the solid, nor the hollow as a gap.
const GRAZING: f64 = 0.15;

/// Signed distance from the surface at every node of a lattice.
pub(super) struct Field {
    /// Signed distance, m, negative inside. It is exact at nodes up to the requested `reach` from the surface; at nodes
    /// farther away its magnitude is at least `reach`.
    pub value: Vec<f64>,
    /// Whether all winding numbers that were computed are about 0 or 1.
    pub clean: bool,
}

/// A lattice edge that may meet the surface.
pub(super) struct Edge {
    /// The two nodes of the edge, the lower index first.
    pub nodes: [u32; 2],
    /// Points where the edge meets the surface (hits), as ascending shares of the edge.
    pub hits: Vec<f64>,
    /// Samples: a share of the edge with the signed distance (m) there. They lie at both ends, and midway between
    /// successive hits unless that stretch of the edge is ignored (see [`GRAZING`]).
    pub samples: Vec<(f64, f64)>,
}

/// Splits `items` into runs of `chunk` items and calls `work` with the index and the items of each run, on all
/// processors.
pub(super) fn in_parallel<T: Send>(items: &mut [T], chunk: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    let queue = Mutex::new(items.chunks_mut(chunk).enumerate());
    let next = || queue.lock().ok().and_then(|mut queue| queue.next());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((index, items)) = next() {
                    work(index, items);
                }
            });
        }
    });
}

/// Computes the signed distances at all nodes, exact within `reach` (m) of the surface. The box from `low` to `high`
/// contains the solid.
pub(super) fn field(solid: &Solid, lattice: &Lattice, (low, high): (DVec3, DVec3), reach: f64) -> Field {
    let [nx, ny, nz] = lattice.size();
    let mut value = vec![0.0; lattice.node_count()];
    let clean = std::sync::atomic::AtomicBool::new(true);
    let slab = 2 * nx * ny * BLOCK;
    in_parallel(&mut value, slab, |index, values| {
        let block = Blocks { solid, lattice, reach, low, high, first: index * slab };
        let z = index * BLOCK;
        for (y, x) in (0..ny).step_by(BLOCK).flat_map(|y| (0..nx).step_by(BLOCK).map(move |x| (y, x))) {
            let end = [x + BLOCK, y + BLOCK, z + BLOCK];
            let end = [end[0].min(nx), end[1].min(ny), end[2].min(nz)];
            if !block.fill([x, y, z], end, values) {
                clean.store(false, std::sync::atomic::Ordering::Relaxed);
            }
        }
    });
    Field { value, clean: clean.into_inner() }
}

/// Classifies blocks of cells in one slab of the lattice ([`BLOCK`] cells high along z); `first` is the first node of
/// the slab.
struct Blocks<'a> {
    solid: &'a Solid,
    lattice: &'a Lattice,
    reach: f64,
    low: DVec3,
    high: DVec3,
    first: usize,
}

impl Blocks<'_> {
    /// Writes the signed distances of the nodes of the cells `from..end` into `values`; returns whether all winding
    /// numbers were about 0 or 1. A ball that the surface does not enter lies wholly inside or outside, so that one
    /// winding number is enough for a block of cells within such a ball.
    fn fill(&self, from: [usize; 3], end: [usize; 3], values: &mut [f64]) -> bool {
        let low = self.lattice.at(from.map(|c| 2 * c as i32));
        let high = self.lattice.at(end.map(|c| 2 * c as i32 - 1));
        let (centre, radius) = ((low + high) / 2.0, low.distance(high) / 2.0);
        let distance = self.solid.distance(centre);
        if distance > radius + self.reach {
            let (sign, clean) = self.side(centre);
            // If the winding number is not about 0 or 1, smaller blocks and finally single nodes are tested, because
            // the winding number of an open surface passes one half far from any triangle.
            if clean {
                self.each(from, end, |node, at| values[node] = sign * (distance - at.distance(centre)));
                return true;
            }
        }
        if (0..3).all(|k| end[k] - from[k] == 1) {
            let mut clean = true;
            self.each(from, end, |node, at| {
                let (sign, one) = self.side(at);
                values[node] = sign * self.solid.distance(at);
                clean &= one;
            });
            return clean;
        }
        let middle = [0, 1, 2].map(|k| (from[k] + end[k]).div_ceil(2));
        let mut clean = true;
        for part in 0..8 {
            let upper = [part & 1, part >> 1 & 1, part >> 2].map(|bit| bit == 1);
            let a = [0, 1, 2].map(|k| if upper[k] { middle[k] } else { from[k] });
            let b = [0, 1, 2].map(|k| if upper[k] { end[k] } else { middle[k] });
            if (0..3).all(|k| a[k] < b[k]) {
                clean &= self.fill(a, b, values);
            }
        }
        clean
    }

    /// Sign of the distance at a point (-1 inside, 1 outside), and whether the winding number there is about 0 or 1.
    fn side(&self, at: DVec3) -> (f64, bool) {
        if at.cmplt(self.low).any() || at.cmpgt(self.high).any() {
            return (1.0, true);
        }
        let winding = self.solid.winding(at);
        let inside = winding > HALF;
        (if inside { -1.0 } else { 1.0 }, (winding - f64::from(u8::from(inside))).abs() < CLEAN)
    }

    /// Calls `f` with the index in the slab and the position (m) of each node of the cells `from..end`.
    fn each(&self, from: [usize; 3], end: [usize; 3], mut f: impl FnMut(usize, DVec3)) {
        for (z, y) in (from[2]..end[2]).flat_map(|z| (from[1]..end[1]).map(move |y| (z, y))) {
            for x in from[0]..end[0] {
                let node = 2 * self.lattice.place([x, y, z]);
                f(node - self.first, self.lattice.position(node as u32));
                f(node + 1 - self.first, self.lattice.position(node as u32 + 1));
            }
        }
    }
}

/// The lattice edges that may meet the surface, in order of their nodes.
pub(super) fn edges(solid: &Solid, lattice: &Lattice, value: &[f64]) -> Vec<Edge> {
    let mut edges = Vec::new();
    for a in 0..value.len() as u32 {
        let from = lattice.position(a);
        for b in lattice.neighbours(a).filter(|&b| b > a) {
            let (va, vb) = (value[a as usize], value[b as usize]);
            // If the edge meets the surface, the distances of its two ends from the surface add up to at most the
            // edge's length. An edge with ends on different sides is always taken, because the winding number of an
            // open surface passes one half far from any triangle.
            let length = lattice.position(b).distance(from);
            if va.abs() + vb.abs() <= 1.001 * length || (va < 0.0) != (vb < 0.0) {
                edges.push(Edge { nodes: [a, b], hits: Vec::new(), samples: vec![(0.0, va), (1.0, vb)] });
            }
        }
    }
    edges.sort_unstable_by_key(|edge| edge.nodes);
    in_parallel(&mut edges, 256, |_, edges| {
        for edge in edges {
            let [a, b] = edge.nodes.map(|n| lattice.position(n));
            edge.hits = solid.hits(a, b);
            for pair in edge.hits.windows(2) {
                let middle = (pair[0] + pair[1]) / 2.0;
                let value = solid.signed(a.lerp(b, middle));
                if value.abs() > GRAZING * (pair[1] - pair[0]) * a.distance(b) {
                    edge.samples.insert(edge.samples.len() - 1, (middle, value));
                }
            }
        }
    });
    edges
}
