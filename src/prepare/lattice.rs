//! A lattice layer around a skin: body-centred cubic tetrahedra, those wholly outside dropped.
//!
//! The tetrahedra are those of isosurface stuffing's background lattice (F. Labelle and J. Shewchuk 2007), unwarped:
//! every one has the same shape, dihedral angles of 60 and 90 degrees and volume `cell`^3 / 12. Nodes are cell corners
//! and cell centres; each face of two cells gives four tetrahedra, one for each of its edges.
//!
//! A tetrahedron is kept where a skin triangle meets it, or where it lies inside. The untouched ones fall into regions
//! that the skin separates; one generalised winding number a region tells inside from outside, so that no ray can be
//! miscounted.

use glam::DVec3;

use super::{Layer, NONE, skin::Sets};

/// A layer has at most this many tetrahedra; more would not fit the step, whatever the device.
pub const MAX_TETRAHEDRA: f64 = 4e6;
/// The lattice around the skin, kept or not, has at most this many tetrahedra (a byte each, and a word a node).
const MAX_LATTICE: f64 = 48e6;
/// Distance below which a triangle counts as touching a tetrahedron, in cells: the rounding of clipping.
const TOUCH: f64 = 1e-9;
/// Room left between the skin's box and lattice planes, in cells: flat sides of a box must not lie in lattice planes,
/// or the slab beyond them would be touched and kept.
const CLEARANCE: f64 = 0.05;

/// Lattice tetrahedra around a closed outward surface (m), of cubes with edge `cell` (m), so that every vertex of the
/// surface lies in one. Errors: a surface smaller than a cell, or more than [`MAX_TETRAHEDRA`].
pub fn lattice(vertices: &[DVec3], triangles: &[[u32; 3]], cell: f64) -> Result<Layer, String> {
    let low = vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let extent = vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low;
    if extent.max_element().is_nan() || extent.max_element() < cell {
        return Err(format!(
            "the surface is {:.3e} m across, smaller than one cell of {cell:.3e} m; choose a smaller cell",
            extent.max_element()
        ));
    }
    let volume = super::mass::properties(vertices, triangles).volume;
    let box_cells = (extent / cell + 4.0).to_array().iter().product::<f64>();
    if 12.0 * volume / cell.powi(3) > MAX_TETRAHEDRA || 12.0 * box_cells > MAX_LATTICE {
        let least = (12.0 * volume / MAX_TETRAHEDRA).cbrt().max(cell * (12.0 * box_cells / MAX_LATTICE).cbrt());
        return Err(format!(
            "a cell of {cell:.3e} m would give more than 4 million tetrahedra; choose one above {:.1e} m",
            1.1 * least
        ));
    }
    let lattice = Lattice::around(low, extent, cell);
    let touched = lattice.touched(vertices, triangles);
    let kept = lattice.kept(&touched, vertices, triangles);
    Ok(lattice.layer(&kept))
}

/// The background lattice: `size` cells from `origin`, coordinates in cells.
pub(super) struct Lattice {
    origin: DVec3,
    cell: f64,
    size: [usize; 3],
}

impl Lattice {
    /// A lattice with more than a cell to spare on each side: its outermost pyramids have no partner and are missing.
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

    /// Nodes, used or not.
    pub(super) fn node_count(&self) -> usize {
        2 * self.size.iter().product::<usize>()
    }

    /// The cell that holds a point well within the lattice.
    pub(super) fn cell_at(&self, point: DVec3) -> [usize; 3] {
        ((point - self.origin) / self.cell).to_array().map(|c| c as usize)
    }

    /// The last cell.
    pub(super) fn last(&self) -> [usize; 3] {
        self.size.map(|s| s - 1)
    }

    /// Position of a node, m.
    pub(super) fn position(&self, node: u32) -> DVec3 {
        self.origin + self.cell * self.local(node)
    }

    fn cell_index(&self, c: [usize; 3]) -> usize {
        c[0] + self.size[0] * (c[1] + self.size[1] * c[2])
    }

    /// Nodes of tetrahedron `e` on the low face of a cell along `axis`: the two centres, then the face's edge. Nodes
    /// are numbered 2 x cell for the low corner and 2 x cell + 1 for the centre.
    fn nodes(&self, cell: [usize; 3], axis: usize, e: usize) -> [u32; 4] {
        const CORNERS: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let mut below = cell;
        below[axis] -= 1;
        let corner = |q: usize| {
            let mut c = cell;
            c[(axis + 1) % 3] += CORNERS[q][0];
            c[(axis + 2) % 3] += CORNERS[q][1];
            2 * self.cell_index(c) as u32
        };
        let centre = |c| 2 * self.cell_index(c) as u32 + 1;
        [centre(below), centre(cell), corner(e), corner((e + 1) % 4)]
    }

    /// Position of a node, in cells from the origin.
    fn local(&self, node: u32) -> DVec3 {
        let cell = node as usize / 2;
        let (x, yz) = (cell % self.size[0], cell / self.size[0]);
        let low = DVec3::new(x as f64, (yz % self.size[1]) as f64, (yz / self.size[1]) as f64);
        low + if node % 2 == 1 { 0.5 } else { 0.0 }
    }

    /// Whether a cell's low face along `axis` has a cell on both sides and all its corners in the lattice.
    fn has_face(&self, cell: [usize; 3], axis: usize) -> bool {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        cell[axis] > 0 && cell[u] + 1 < self.size[u] && cell[v] + 1 < self.size[v]
    }

    /// Calls `f` with the index and the nodes of every tetrahedron of the cells in a box, ends included. Tetrahedron
    /// indices are 12 x cell + 4 x axis + edge.
    pub(super) fn each(&self, from: [usize; 3], to: [usize; 3], mut f: impl FnMut(usize, [u32; 4])) {
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    for axis in (0..3).filter(|&axis| self.has_face([x, y, z], axis)) {
                        for e in 0..4 {
                            let index = 12 * self.cell_index([x, y, z]) + 4 * axis + e;
                            f(index, self.nodes([x, y, z], axis, e));
                        }
                    }
                }
            }
        }
    }

    /// Which tetrahedra a triangle of the surface meets.
    fn touched(&self, vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<bool> {
        let mut touched = vec![false; 12 * self.size.iter().product::<usize>()];
        let mut polygon = [Vec::new(), Vec::new()];
        for t in triangles {
            let corners = t.map(|i| (vertices[i as usize] - self.origin) / self.cell);
            let low = corners[0].min(corners[1]).min(corners[2]) - 0.5;
            let high = corners[0].max(corners[1]).max(corners[2]) + 1.5;
            // A tetrahedron reaches half a cell beyond its face, and belongs to the cell above that face.
            let from = low.to_array().map(|c| c.max(0.0) as usize);
            let to = [0, 1, 2].map(|k| (high[k] as usize).min(self.size[k] - 1));
            self.each(from, to, |index, nodes| {
                if !touched[index] {
                    touched[index] = meets(&corners, nodes.map(|n| self.local(n)), &mut polygon);
                }
            });
        }
        touched
    }

    /// Touched tetrahedra, and those of regions that the surface winds around.
    fn kept(&self, touched: &[bool], vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<bool> {
        let node_count = self.node_count();
        let all = self.last();
        // Nodes of an untouched tetrahedron all lie on one side of the surface.
        let mut sets = Sets::new(node_count);
        let mut clear = vec![false; node_count];
        self.each([0; 3], all, |index, nodes| {
            if !touched[index] {
                for node in nodes {
                    sets.join(nodes[0], node);
                    clear[node as usize] = true;
                }
            }
        });
        let (labels, count) = sets.labels();
        let mut inside: Vec<Option<bool>> = vec![None; count];
        for node in (0..node_count).filter(|&n| clear[n]) {
            inside[labels[node] as usize].get_or_insert_with(|| {
                let point = self.position(node as u32);
                winding_number(vertices, triangles, point) > 0.5
            });
        }
        let mut kept = touched.to_vec();
        self.each([0; 3], all, |index, nodes| kept[index] |= inside[labels[nodes[0] as usize] as usize] == Some(true));
        kept
    }

    /// The kept tetrahedra as a layer, nodes in lattice order.
    fn layer(&self, kept: &[bool]) -> Layer {
        let all = self.last();
        let mut number = vec![NONE; self.node_count()];
        let mut layer = Layer::default();
        self.each([0; 3], all, |index, nodes| {
            if kept[index] {
                layer.tetrahedra.push(nodes);
                for node in nodes {
                    number[node as usize] = 0;
                }
            }
        });
        for (node, number) in number.iter_mut().enumerate().filter(|(_, n)| **n != NONE) {
            *number = layer.nodes.len() as u32;
            layer.nodes.push(self.position(node as u32));
        }
        for t in &mut layer.tetrahedra {
            *t = t.map(|n| number[n as usize]);
        }
        layer.bound = vec![false; layer.nodes.len()];
        layer
    }
}

/// Whether a triangle meets a tetrahedron (positive volume, size about 1): clipped by its four faces, something stays.
fn meets(triangle: &[DVec3; 3], tetrahedron: [DVec3; 4], polygon: &mut [Vec<DVec3>; 2]) -> bool {
    let [current, next] = polygon;
    // Boxes first: most pairs part there.
    let [a, b, c] = *triangle;
    let [p, q, r, s] = tetrahedron;
    let above = (a.min(b).min(c) - TOUCH).cmpgt(p.max(q).max(r.max(s)));
    let below = (a.max(b).max(c) + TOUCH).cmplt(p.min(q).min(r.min(s)));
    if above.any() || below.any() {
        return false;
    }
    current.clear();
    current.extend(triangle);
    for face in super::layer::FACES {
        let [a, b, c] = face.map(|k| tetrahedron[k]);
        let normal = (b - a).cross(c - a).normalize();
        let height = |p: DVec3| normal.dot(p - a) - TOUCH;
        next.clear();
        for i in 0..current.len() {
            let (p, q) = (current[i], current[(i + 1) % current.len()]);
            let (hp, hq) = (height(p), height(q));
            if hp <= 0.0 {
                next.push(p);
            }
            if (hp <= 0.0) != (hq <= 0.0) {
                next.push(p + (q - p) * (hp / (hp - hq)));
            }
        }
        std::mem::swap(current, next);
        if current.is_empty() {
            return false;
        }
    }
    true
}

/// How often a surface winds around a point (solid angles after A. van Oosterom and J. Strackee 1983): 1 inside a closed
/// outward surface, 0 outside; in between for an open one.
pub fn winding_number(vertices: &[DVec3], triangles: &[[u32; 3]], point: DVec3) -> f64 {
    let mut angle = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|i| vertices[i as usize] - point);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        angle += 2.0 * a.dot(b.cross(c)).atan2(denominator);
    }
    angle / (4.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{embed, layer, mass, sphere};

    fn volume(layer: &Layer) -> f64 {
        layer.tetrahedra.iter().map(|t| layer::volume6(&layer.nodes, t) / 6.0).sum()
    }

    #[test]
    fn a_sphere_is_covered_and_no_more_than_a_cell_is_added() {
        let (vertices, triangles) = sphere::icosphere(0.1);
        for cell in [0.021, 0.02, 0.2 / 9.99, 0.2 / 9.5, 0.2 / 10.01] {
            check_ball(&vertices, &triangles, cell);
        }
    }

    fn check_ball(vertices: &[DVec3], triangles: &[[u32; 3]], cell: f64) {
        let layer = lattice(vertices, triangles, cell).unwrap();
        let each = cell.powi(3) / 12.0;
        assert!(layer.tetrahedra.iter().all(|t| (layer::volume6(&layer.nodes, t) / 6.0 - each).abs() < 1e-9 * each));
        let embeddings = embed(vertices, &layer).unwrap();
        assert!(embed::extrapolation(&embeddings) < 1e-8);
        let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        let ours = volume(&layer);
        assert!(ours > ball(0.1) && ours < ball(0.1 + cell), "{ours}");
        assert_eq!(layer::parts(&layer).1, 1);
        let (skin, faces, _) = layer::boundary(&layer);
        assert!((mass::properties(&skin, &faces).volume - ours).abs() < 1e-9 * ours);
    }

    #[test]
    fn a_hollow_stays_hollow() {
        let (mut vertices, mut triangles) = sphere::icosphere(0.1);
        let solid = volume(&lattice(&vertices, &triangles, 0.01).unwrap());
        let count = vertices.len() as u32;
        vertices.extend_from_within(..);
        vertices[count as usize..].iter_mut().for_each(|v| *v *= 0.6);
        let inner: Vec<_> = triangles.iter().map(|&[a, b, c]| [a + count, c + count, b + count]).collect();
        triangles.extend(inner);
        let hollow = volume(&lattice(&vertices, &triangles, 0.01).unwrap());
        let missing = (solid - hollow) / (4.0 / 3.0 * std::f64::consts::PI * 0.06f64.powi(3));
        // All of the hollow but a rim of at most one cell: (0.05 / 0.06)^3.
        assert!(missing > 0.57 && missing < 1.0, "{missing}");
    }

    #[test]
    fn a_box_on_lattice_planes_gets_no_slab_beyond_the_next_cell() {
        let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [1, 1, 1]));
        let layer = lattice(&vertices, &triangles, 0.25).unwrap();
        let overhang = layer.nodes.iter().fold(0f64, |o, n| o.max(n.max_element() - 1.0).max(-n.min_element()));
        assert!(overhang < 0.25, "{overhang}");
    }

    #[test]
    fn a_plate_thinner_than_a_cell_is_one_part_and_covers_its_skin() {
        let (v, t, _) = layer::boundary(&layer::kuhn_box(DVec3::ZERO, DVec3::new(1.0, 0.01, 1.0), [1, 1, 1]));
        let layer = lattice(&v, &t, 0.1).unwrap();
        assert_eq!(layer::parts(&layer).1, 1);
        let inner: Vec<DVec3> =
            (0..100).map(|i| DVec3::new(i as f64 / 99.0, 0.01, (i * i % 100) as f64 / 99.0)).collect();
        assert!(embed::extrapolation(&embed(&inner, &layer).unwrap()) < 1e-8);
    }

    #[test]
    fn too_coarse_and_too_fine_cells_are_refused_with_the_remedy() {
        let (vertices, triangles) = sphere::icosphere(0.1);
        assert!(lattice(&vertices, &triangles, 0.3).unwrap_err().contains("choose a smaller cell"));
        let error = lattice(&vertices, &triangles, 1e-4).unwrap_err();
        assert!(error.contains("more than 4 million") && error.contains("choose one above"), "{error}");
    }
}
