//! Contacts by exact rays in f64: depth of each facing vertex below the other skin, and the records gathered from it.
//! Twin of the depth and contact stages.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::oracle::skin;
use crate::prepare::{Embedding, Layer};

/// Where a vertex's line along the region's normal meets the other skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Overlap along the normal, m, positive.
    pub depth: f64,
    /// Triangle of the other skin.
    pub triangle: u32,
    /// Barycentrics of the point on that triangle.
    pub barycentric: [f64; 3],
}

/// What carries a point of contact.
#[derive(Debug, Clone, PartialEq)]
pub enum Carrier {
    /// Nodes of a soft body (index into the simulation's bodies) with weights; each node once.
    Nodes(usize, Vec<(u32, f64)>),
    /// The tool.
    Tool,
    /// Nothing that moves.
    Fixed,
}

/// A point of contact.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// World position, m.
    pub position: DVec3,
    /// What it moves with.
    pub carrier: Carrier,
}

/// One contact. The force on `first` is -area (k depth + d depth') normal, the opposite acts on `second`.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Unit normal from body A to body B.
    pub normal: DVec3,
    /// Area projected on the normal, m^2.
    pub area: f64,
    /// Overlap normal . (first - second), m.
    pub depth: f64,
    /// Penalty stiffness per projected area, N/m^3.
    pub stiffness: f64,
    /// Penalty damping per projected area, N s/m^3.
    pub damping: f64,
    /// Point of body A.
    pub first: Point,
    /// Point of body B.
    pub second: Point,
    /// Whether the gathered vertex belongs to body A.
    pub of_first: bool,
    /// The gathered skin vertex.
    pub vertex: u32,
    /// Where its ray met the other skin; `None` against a plane.
    pub hit: Option<Hit>,
}

/// The penalty law of a pair of bodies.
#[derive(Debug, Clone, Copy)]
pub struct Law {
    /// Stiffness per projected area, N/m^3.
    pub stiffness: f64,
    /// Damping per projected area, N s/m^3.
    pub damping: f64,
    /// Deeper overlaps are no contact, m.
    pub depth_limit: f64,
}

/// A skin where it stands.
#[derive(Debug, Clone)]
pub struct Surface<'a> {
    /// World positions of its vertices.
    pub positions: Vec<DVec3>,
    /// Triangles, counter-clockwise from outside.
    pub triangles: &'a [[u32; 3]],
    /// Rest area of each vertex, m^2.
    pub areas: &'a [f64],
    /// What its vertices move with.
    pub support: Support<'a>,
}

/// What carries a skin.
#[derive(Debug, Clone, Copy)]
pub enum Support<'a> {
    /// A soft body: its index in the simulation, its layer, the embedding of each vertex.
    Soft(usize, &'a Layer, &'a [Embedding]),
    /// The tool.
    Tool,
    /// A resting body.
    Fixed,
}

impl Surface<'_> {
    /// The point with these barycentric weights on these vertices.
    fn point(&self, vertices: &[(u32, f64)]) -> Point {
        let position = vertices.iter().map(|(v, w)| self.positions[*v as usize] * *w).sum();
        let carrier = match self.support {
            Support::Tool => Carrier::Tool,
            Support::Fixed => Carrier::Fixed,
            Support::Soft(body, layer, embedding) => {
                let mut nodes = BTreeMap::new();
                for (v, w) in vertices {
                    let e = &embedding[*v as usize];
                    for (node, weight) in layer.tetrahedra[e.tetrahedron as usize].iter().zip(e.weights) {
                        *nodes.entry(*node).or_insert(0.0) += w * weight;
                    }
                }
                Carrier::Nodes(body, nodes.into_iter().collect())
            }
        };
        Point { position, carrier }
    }
}

/// For each vertex of A that faces along `normal` (unit, from A to B): its depth beyond B's facing sheet, where that is
/// positive and at most `depth_limit`. Of several facing triangles of B on the line the lowest along `normal` counts,
/// the first seen from A. For vertices of B against A's sheet call it with -normal and the bodies swapped.
pub fn ray_depths(
    normal: DVec3,
    a_positions: &[DVec3],
    a_triangles: &[[u32; 3]],
    b_positions: &[DVec3],
    b_triangles: &[[u32; 3]],
    depth_limit: f64,
) -> Vec<Option<Hit>> {
    let grid = Grid::new(normal, b_positions, b_triangles);
    let facing = skin::normals(a_positions, a_triangles);
    let hit = |(x, m): (&DVec3, &DVec3)| {
        if m.dot(normal) <= 0.0 {
            return None;
        }
        let (height, triangle, barycentric) = grid.lowest(*x)?;
        let depth = normal.dot(*x) - height;
        (depth > 0.0 && depth <= depth_limit).then_some(Hit { depth, triangle, barycentric })
    };
    a_positions.iter().zip(&facing).map(hit).collect()
}

/// Contacts of two skins along a region's normal: first A's vertices, then B's, in ascending order. Each side counts
/// half, since both gather.
pub fn gather(normal: DVec3, a: &Surface, b: &Surface, law: &Law) -> Vec<Contact> {
    let mut contacts = gather_side(normal, a, b, law, true);
    contacts.extend(gather_side(-normal, b, a, law, false));
    contacts
}

fn gather_side(outward: DVec3, own: &Surface, other: &Surface, law: &Law, of_first: bool) -> Vec<Contact> {
    let hits = ray_depths(outward, &own.positions, own.triangles, &other.positions, other.triangles, law.depth_limit);
    let facing = skin::normals(&own.positions, own.triangles);
    let contact = |(vertex, hit): (usize, Hit)| {
        let corners = other.triangles[hit.triangle as usize];
        let mine = own.point(&[(vertex as u32, 1.0)]);
        let weights: [(u32, f64); 3] = std::array::from_fn(|k| (corners[k], hit.barycentric[k]));
        let theirs = other.point(&weights);
        let (first, second) = if of_first { (mine, theirs) } else { (theirs, mine) };
        Contact {
            normal: if of_first { outward } else { -outward },
            area: 0.5 * own.areas[vertex] * facing[vertex].dot(outward),
            depth: hit.depth,
            stiffness: law.stiffness,
            damping: law.damping,
            first,
            second,
            of_first,
            vertex: vertex as u32,
            hit: Some(hit),
        }
    };
    hits.into_iter().enumerate().filter_map(|(v, hit)| Some((v, hit?))).map(contact).collect()
}

/// Contacts of a skin with the fixed half-space `plane . x <= offset`; only the skin gathers, with full weight.
pub fn gather_plane(a: &Surface, plane: DVec3, offset: f64, law: &Law) -> Vec<Contact> {
    let facing = skin::normals(&a.positions, a.triangles);
    let contact = |(vertex, x): (usize, &DVec3)| {
        let depth = offset - plane.dot(*x);
        let towards = -facing[vertex].dot(plane);
        (towards > 0.0 && depth > 0.0 && depth <= law.depth_limit).then(|| Contact {
            normal: -plane,
            area: a.areas[vertex] * towards,
            depth,
            stiffness: law.stiffness,
            damping: law.damping,
            first: a.point(&[(vertex as u32, 1.0)]),
            second: Point { position: *x + depth * plane, carrier: Carrier::Fixed },
            of_first: true,
            vertex: vertex as u32,
            hit: None,
        })
    };
    a.positions.iter().enumerate().filter_map(contact).collect()
}

/// Triangles that face against a normal, binned on a plane across it.
struct Grid<'a> {
    normal: DVec3,
    tangents: [DVec3; 2],
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    low: DVec2,
    cell: f64,
    size: [usize; 2],
    /// First entry of each cell in `members`, and the end.
    starts: Vec<usize>,
    members: Vec<u32>,
}

impl<'a> Grid<'a> {
    fn new(normal: DVec3, positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        let tangents: [DVec3; 2] = normal.any_orthonormal_pair().into();
        let facing: Vec<u32> = (0..triangles.len() as u32)
            .filter(|t| skin::area_vector(positions, &triangles[*t as usize]).dot(normal) < 0.0)
            .collect();
        let mut grid = Self {
            normal,
            tangents,
            positions,
            triangles,
            low: DVec2::ZERO,
            cell: 1.0,
            size: [1, 1],
            starts: vec![],
            members: vec![],
        };
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in facing.iter().flat_map(|t| grid.corners(*t)) {
            low = low.min(corner);
            high = high.max(corner);
        }
        if !facing.is_empty() {
            let extent = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
            // About one cell a triangle, but never more than 1024 a side for slender outlines.
            grid.cell = (extent.x * extent.y / facing.len() as f64).sqrt().max(extent.max_element() / 1024.0);
            grid.low = low;
            grid.size = [extent.x, extent.y].map(|e| (e / grid.cell) as usize + 1);
        }
        grid.fill(&facing);
        grid
    }

    fn fill(&mut self, facing: &[u32]) {
        let cells = self.size[0] * self.size[1];
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); cells];
        for &t in facing {
            let corners = self.corners(t);
            let low = self.clamped(corners[0].min(corners[1]).min(corners[2]));
            let high = self.clamped(corners[0].max(corners[1]).max(corners[2]));
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    lists[y * self.size[0] + x].push(t);
                }
            }
        }
        self.starts = vec![0; cells + 1];
        for (cell, list) in lists.iter().enumerate() {
            self.starts[cell + 1] = self.starts[cell] + list.len();
        }
        self.members = lists.concat();
    }

    fn project(&self, x: DVec3) -> DVec2 {
        DVec2::new(self.tangents[0].dot(x), self.tangents[1].dot(x))
    }

    fn corners(&self, triangle: u32) -> [DVec2; 3] {
        self.triangles[triangle as usize].map(|i| self.project(self.positions[i as usize]))
    }

    fn clamped(&self, x: DVec2) -> [usize; 2] {
        let at = (x - self.low) / self.cell;
        [(at.x.max(0.0) as usize).min(self.size[0] - 1), (at.y.max(0.0) as usize).min(self.size[1] - 1)]
    }

    /// Height, triangle and barycentrics of the lowest facing triangle on the line through `x`; the lower triangle
    /// where two are equally low (a shared edge or vertex).
    fn lowest(&self, x: DVec3) -> Option<(f64, u32, [f64; 3])> {
        let at = self.project(x);
        let [column, row] = self.clamped(at);
        let cell = row * self.size[0] + column;
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        for &t in &self.members[self.starts[cell]..self.starts[cell + 1]] {
            let Some(weights) = barycentric(self.corners(t), at) else { continue };
            let corners = self.triangles[t as usize];
            let height: f64 = (0..3).map(|k| weights[k] * self.normal.dot(self.positions[corners[k] as usize])).sum();
            if best.is_none_or(|b| height < b.0) {
                best = Some((height, t, weights));
            }
        }
        best
    }
}

/// Barycentrics of `at` in a projected triangle of either orientation; `None` outside it. Watertight: the two
/// triangles of an edge compute the same number with opposite sign.
fn barycentric(corners: [DVec2; 3], at: DVec2) -> Option<[f64; 3]> {
    let [a, b, c] = corners.map(|p| p - at);
    let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
    let inside = weights.iter().all(|w| *w >= 0.0) || weights.iter().all(|w| *w <= 0.0);
    let sum: f64 = weights.iter().sum();
    (inside && sum != 0.0).then(|| weights.map(|w| w / sum))
}
