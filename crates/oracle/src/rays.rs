//! Narrow phase in f64: rays along one direction against a skin (triangle mesh), the first triangle that each ray hits,
//! and whether a ray passes an outline (an edge at which its hits change) so closely that rounding decides. Triangles
//! are kept in a grid on a plane perpendicular to the direction.

use glam::{DVec2, DVec3};

use crate::skin;

/// The first hit of a ray on a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance from the ray's start, m, positive.
    pub depth: f64,
    /// The triangle that is hit; the one of lower index where the ray hits two at once (on an edge or a vertex).
    pub triangle: u32,
    /// Barycentric coordinates of the hit on the triangle.
    pub barycentric: [f64; 3],
    /// Whether the ray leaves the body at the hit.
    pub leaves: bool,
}

/// A skin prepared for rays along -`normal`. Triangles seen edge-on are never hit.
pub struct Rays<'a> {
    plane: Plane,
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    /// Vertices projected onto the plane.
    flat: Vec<DVec2>,
    cells: Cells,
}

impl<'a> Rays<'a> {
    /// Prepares a skin for rays along -`normal` (unit).
    pub fn new(normal: DVec3, positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        let plane = Plane::new(normal);
        let flat: Vec<DVec2> = positions.iter().map(|x| plane.project(*x)).collect();
        let boxes: Vec<[DVec2; 2]> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| flat[v as usize]);
                [a.min(b).min(c), a.max(b).max(c)]
            })
            .collect();
        Rays { plane, positions, triangles, flat, cells: Cells::new(&boxes) }
    }

    /// First hit of the ray from `x` along -`normal`; `None` if the ray hits no triangle.
    pub fn first(&self, x: DVec3) -> Option<RayHit> {
        let (at, height) = (self.plane.project(x), self.plane.normal.dot(x));
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        for &t in self.cells.around(at) {
            let corners = self.triangles[t as usize];
            let Some(weights) = barycentric(corners.map(|v| self.flat[v as usize]), at) else { continue };
            let met: f64 =
                (0..3).map(|k| weights[k] * self.plane.normal.dot(self.positions[corners[k] as usize])).sum();
            let depth = height - met;
            if depth > 0.0 && best.is_none_or(|best| depth < best.0) {
                best = Some((depth, t, weights));
            }
        }
        let (depth, triangle, barycentric) = best?;
        let outward = skin::area_vector(self.positions, &self.triangles[triangle as usize]);
        Some(RayHit { depth, triangle, barycentric, leaves: outward.dot(self.plane.normal) < 0.0 })
    }
}

/// Outlines of a skin seen along a direction: the edges at which the hits of a ray change abruptly. These are open
/// edges, edges of more than two triangles, and edges between a triangle that faces the viewer and one that does not.
pub struct Outline {
    plane: Plane,
    edges: Vec<[DVec2; 2]>,
    cells: Cells,
    within: f64,
}

impl Outline {
    /// Finds the outlines of a skin along `normal`, for queries of distances up to `within` (m).
    pub fn new(normal: DVec3, positions: &[DVec3], triangles: &[[u32; 3]], within: f64) -> Self {
        let plane = Plane::new(normal);
        let mut uses: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * triangles.len());
        for t in triangles {
            let faces = skin::area_vector(positions, t).dot(normal) < 0.0;
            uses.extend((0..3).map(|k| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                (a.min(b), a.max(b), faces)
            }));
        }
        uses.sort_unstable();
        let jumps = |uses: &&[(u32, u32, bool)]| uses.len() != 2 || uses[0].2 != uses[1].2;
        let ends = |uses: &[(u32, u32, bool)]| [uses[0].0, uses[0].1].map(|v| plane.project(positions[v as usize]));
        let edges: Vec<[DVec2; 2]> = uses.chunk_by(|e, f| (e.0, e.1) == (f.0, f.1)).filter(jumps).map(ends).collect();
        let boxes: Vec<_> = edges.iter().map(|[a, b]| [a.min(*b) - within, a.max(*b) + within]).collect();
        Outline { plane, edges, cells: Cells::new(&boxes), within }
    }

    /// Whether the line through `x` along the normal passes an outline within the distance `within` given to
    /// [`Outline::new`].
    pub fn is_near(&self, x: DVec3) -> bool {
        let at = self.plane.project(x);
        let near = |&e: &u32| {
            let [a, b] = self.edges[e as usize];
            let along = b - a;
            let share = (at - a).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
            (a + share.clamp(0.0, 1.0) * along).distance(at) <= self.within
        };
        self.cells.around(at).iter().any(near)
    }
}

/// A plane perpendicular to a direction, with two tangents.
struct Plane {
    normal: DVec3,
    tangents: [DVec3; 2],
}

impl Plane {
    fn new(normal: DVec3) -> Self {
        Plane { normal, tangents: normal.any_orthonormal_pair().into() }
    }

    fn project(&self, x: DVec3) -> DVec2 {
        DVec2::new(self.tangents[0].dot(x), self.tangents[1].dot(x))
    }
}

/// A grid of squares on a plane; each cell lists the boxes that overlap it.
struct Cells {
    low: DVec2,
    cell: f64,
    size: [usize; 2],
    /// First entry of each cell in `members`, then the end of the last cell's entries.
    starts: Vec<usize>,
    members: Vec<u32>,
}

impl Cells {
    /// Makes about one cell for each box, but at most 1024 cells a side, since a long and narrow grid would have far
    /// more along its length.
    fn new(boxes: &[[DVec2; 2]]) -> Self {
        let low = boxes.iter().fold(DVec2::INFINITY, |low, b| low.min(b[0]));
        let high = boxes.iter().fold(DVec2::NEG_INFINITY, |high, b| high.max(b[1]));
        let mut cells = Cells { low: DVec2::ZERO, cell: 1.0, size: [1, 1], starts: vec![0, 0], members: vec![] };
        if boxes.is_empty() {
            return cells;
        }
        let extent = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
        cells.low = low;
        cells.cell = (extent.x * extent.y / boxes.len() as f64).sqrt().max(extent.max_element() / 1024.0);
        cells.size = [extent.x, extent.y].map(|e| (e / cells.cell) as usize + 1);
        let mut entries: Vec<(usize, u32)> = Vec::with_capacity(4 * boxes.len());
        for (i, [low, high]) in boxes.iter().enumerate() {
            let ([x0, y0], [x1, y1]) = (cells.clamped(*low), cells.clamped(*high));
            entries.extend(
                (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y))).map(|(x, y)| (y * cells.size[0] + x, i as u32)),
            );
        }
        entries.sort_unstable();
        cells.starts = vec![0; cells.size[0] * cells.size[1] + 1];
        entries.iter().for_each(|(cell, _)| cells.starts[cell + 1] += 1);
        for cell in 1..cells.starts.len() {
            cells.starts[cell] += cells.starts[cell - 1];
        }
        cells.members = entries.into_iter().map(|(_, i)| i).collect();
        cells
    }

    fn clamped(&self, x: DVec2) -> [usize; 2] {
        let at = (x - self.low) / self.cell;
        [(at.x.max(0.0) as usize).min(self.size[0] - 1), (at.y.max(0.0) as usize).min(self.size[1] - 1)]
    }

    /// The boxes that may contain a point.
    fn around(&self, x: DVec2) -> &[u32] {
        let [column, row] = self.clamped(x);
        let cell = row * self.size[0] + column;
        &self.members[self.starts[cell]..self.starts[cell + 1]]
    }
}

/// Barycentric coordinates of `at` in a projected triangle of either orientation; `None` outside it. The test is
/// watertight: the two triangles that share an edge compute the same number for it with opposite sign.
fn barycentric(corners: [DVec2; 3], at: DVec2) -> Option<[f64; 3]> {
    let [a, b, c] = corners.map(|p| p - at);
    let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
    let inside = weights.iter().all(|w| *w >= 0.0) || weights.iter().all(|w| *w <= 0.0);
    let sum: f64 = weights.iter().sum();
    (inside && sum != 0.0).then(|| weights.map(|w| w / sum))
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::{layer, sphere};

    use super::*;

    /// A cube with z from 0 to 1, and a smaller cube above it with z from 2 to 2.5.
    fn cubes() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let boxed = |low: DVec3, high: DVec3| layer::boundary(&layer::kuhn_box(low, high, [2, 2, 2]));
        let (mut vertices, mut triangles, _) = boxed(DVec3::ZERO, DVec3::ONE);
        let (more, others, _) = boxed(DVec3::new(0.2, 0.2, 2.0), DVec3::new(0.7, 0.7, 2.5));
        let first = vertices.len() as u32;
        vertices.extend(more);
        triangles.extend(others.into_iter().map(|t| t.map(|v| v + first)));
        (vertices, triangles)
    }

    #[test]
    fn a_ray_says_what_it_passes_first_and_whether_it_was_inside() {
        let (vertices, triangles) = cubes();
        let rays = Rays::new(DVec3::Z, &vertices, &triangles);
        let first = |z: f64| rays.first(DVec3::new(0.61, 0.43, z)).map(|c| ((c.depth * 1e9).round() / 1e9, c.leaves));
        assert_eq!(first(3.0), Some((0.5, false)));
        assert_eq!(first(2.3), Some((0.3, true)));
        assert_eq!(first(1.5), Some((0.5, false)));
        assert_eq!(first(0.2), Some((0.2, true)));
        assert_eq!(first(-0.1), None);
        let beside = rays.first(DVec3::new(0.9, 0.43, 3.0)).unwrap();
        assert!((beside.depth - 2.0).abs() < 1e-12 && !beside.leaves);
        assert_eq!(rays.first(DVec3::new(1.1, 0.4, 3.0)), None);
    }

    #[test]
    fn outlines_are_where_the_layers_change() {
        let (vertices, triangles) = cubes();
        let outline = Outline::new(DVec3::Z, &vertices, &triangles, 0.01);
        let near = |x: f64, y: f64| outline.is_near(DVec3::new(x, y, 7.0));
        // The only outlines are the walls of both cubes, seen edge-on; there are none between or within the cubes.
        assert!(near(0.009, 0.5) && near(0.995, 0.2) && near(0.205, 0.3) && near(0.5, 0.692));
        assert!(!near(0.02, 0.5) && !near(0.5, 0.5) && !near(0.25, 0.3) && !near(0.85, 0.9) && !near(2.0, 2.0));
        // The outline of a ball is its equator.
        let (vertices, triangles) = sphere::icosphere(1.0);
        let outline = Outline::new(DVec3::new(0.3, 0.2, 0.9).normalize(), &vertices, &triangles, 1e-3);
        let count = vertices.iter().filter(|x| outline.is_near(**x)).count();
        assert!(count > 10 && count < vertices.len() / 5, "{count} vertices near the outline");
    }
}
