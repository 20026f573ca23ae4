//! First part of the repair of a surface, before it becomes the skin of a body: degenerate and duplicate faces
//! (triangles) are removed, and vertices that coincide at *open edges* (edges with only one triangle) are merged.

use std::collections::BTreeMap;

use glam::DVec3;

use super::report::{Count, RepairReport};
use super::topology::Edges;
use super::{Refusal, points};
use crate::scene::triangles::TriangleMesh;

/// Greatest allowed magnitude of a coordinate: a product of four lengths must not overflow single precision (3.4e38).
const LARGEST_COORDINATE: f64 = 1e9;
/// Greatest allowed distance between neighbouring f32 numbers at the largest coordinate, as a share of the mean edge
/// length: with one thousandth, rounding to f32 still preserves the shape.
const COARSEST: f64 = 1e-3;
/// A triangle is degenerate if twice its area is at most this share of its longest edge squared: its normal could not
/// be computed in single precision.
const THINNEST: f64 = 1e-7;
/// Vertices at open edges coincide if their distance is at most this share of the bounding box's diagonal: exporters
/// write six digits, so copies of one vertex may differ by that much.
const SAME_PLACE: f64 = 1e-6;

/// The triangles of the surface that is being repaired.
pub(super) struct Faces<'a> {
    pub vertices: &'a [DVec3],
    /// Vertex indices of each triangle.
    pub corners: Vec<[u32; 3]>,
    /// For each triangle, its index in the file.
    pub origin: Vec<usize>,
}

/// Refuses a mesh without faces, a face with the index of a vertex that does not exist, and a used vertex with a
/// coordinate that is not finite, is too large for single precision, or for which the spacing of single-precision
/// numbers is too coarse.
pub(super) fn check(mesh: &TriangleMesh) -> Result<(), Refusal> {
    let refuse = |problem, remedy| Err(Refusal { problem, triangle: None, remedy });
    if mesh.triangles.is_empty() {
        return refuse("has no faces".into(), "export the surface with its faces");
    }
    let count = mesh.vertices.len();
    let wrong = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= count);
    if let Some(triangle) = mesh.triangles.iter().position(wrong) {
        let problem = format!("a face names a vertex beyond the last of {count} vertices");
        return Err(Refusal { problem, triangle: Some(triangle), remedy: "correct the index, or export again" });
    }
    let greatest = |&vertex: &u32| mesh.vertices[vertex as usize].abs().to_array().into_iter().fold(0.0, f64::max);
    let is_finite = |&vertex: &u32| mesh.vertices[vertex as usize].is_finite();
    if !mesh.triangles.iter().flatten().all(is_finite) {
        return refuse("a coordinate is not a finite number".into(), "export the surface again");
    }
    let greatest = mesh.triangles.iter().flatten().map(greatest).fold(0.0, f64::max);
    if greatest > LARGEST_COORDINATE {
        let problem = format!("coordinates reach {greatest:.3e}, beyond {LARGEST_COORDINATE:e}");
        return refuse(problem, "scale the file to a sensible unit, such as metres");
    }
    let length = |&triangle: &[u32; 3]| {
        let [a, b, c] = points(&mesh.vertices, triangle);
        (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0
    };
    let mean_edge = mesh.triangles.iter().map(length).sum::<f64>() / mesh.triangles.len() as f64;
    let spacing = greatest * f64::from(f32::EPSILON);
    if spacing > COARSEST * mean_edge {
        let problem = format!(
            "reaches {greatest:.4} from the origin, where neighbouring f32 numbers are {spacing:.2e} apart, but the \
             mean edge is {mean_edge:.2e}"
        );
        return refuse(problem, "move the surface to the origin of its file and place it with `position`");
    }
    Ok(())
}

impl<'a> Faces<'a> {
    pub(super) fn new(vertices: &'a [DVec3], corners: Vec<[u32; 3]>) -> Self {
        Faces { vertices, origin: (0..corners.len()).collect(), corners }
    }

    /// Removes degenerate and duplicate faces and merges vertices until nothing changes: the removal of a sliver may
    /// leave an open edge whose vertices coincide, and merged vertices may reveal duplicates and slivers. In every
    /// round the faces use fewer vertices, so the loop ends.
    pub(super) fn clean(&mut self, report: &mut RepairReport) {
        loop {
            self.drop_flat(&mut report.zero_area);
            self.drop_copies(&mut report.duplicates);
            if !self.weld(&mut report.welded_vertices) {
                return;
            }
        }
    }

    /// Keeps the triangles for whose index `keep` returns true; removes the other triangles and counts them in
    /// `dropped`.
    fn retain(&mut self, dropped: &mut Count, keep: impl Fn(usize) -> bool) {
        let mut kept = 0;
        for triangle in 0..self.corners.len() {
            if keep(triangle) {
                self.corners[kept] = self.corners[triangle];
                self.origin[kept] = self.origin[triangle];
                kept += 1;
            } else {
                dropped.add(self.origin[triangle]);
            }
        }
        self.corners.truncate(kept);
        self.origin.truncate(kept);
    }

    fn drop_flat(&mut self, dropped: &mut Count) {
        let flat: Vec<bool> = self.corners.iter().map(|&triangle| is_flat(points(self.vertices, triangle))).collect();
        self.retain(dropped, |triangle| !flat[triangle]);
    }

    /// Removes triangles that have the same vertices as an earlier one.
    fn drop_copies(&mut self, dropped: &mut Count) {
        let key = |(index, &corners): (usize, &[u32; 3])| {
            let mut key = corners;
            key.sort_unstable();
            (key, index)
        };
        let mut sorted: Vec<([u32; 3], usize)> = self.corners.iter().enumerate().map(key).collect();
        sorted.sort_unstable();
        let mut again = vec![false; self.corners.len()];
        sorted.windows(2).filter(|pair| pair[0].0 == pair[1].0).for_each(|pair| again[pair[1].1] = true);
        self.retain(dropped, |triangle| !again[triangle]);
    }

    /// Merges vertices that coincide at open edges: faces use the first of them from now on. Returns whether any face
    /// changed.
    fn weld(&mut self, welded: &mut Count) -> bool {
        let first = self.first_at_place();
        let before = welded.count;
        let mut seen = vec![false; self.vertices.len()];
        for (corners, &origin) in self.corners.iter_mut().zip(&self.origin) {
            for vertex in corners {
                let to = first[*vertex as usize];
                if to != *vertex && !std::mem::replace(&mut seen[*vertex as usize], true) {
                    welded.add(origin);
                }
                *vertex = to;
            }
        }
        welded.count > before
    }

    /// For each vertex, the vertex to use in its place: at open edges the first vertex that coincides with it (see
    /// [`SAME_PLACE`]), otherwise the vertex itself. Vertices on no open edge are never merged, so that two closed
    /// surfaces which touch stay separate.
    fn first_at_place(&self) -> Vec<u32> {
        let mut open: Vec<u32> = Edges::new(&self.corners).open().flatten().collect();
        open.sort_unstable();
        open.dedup();
        let mut first: Vec<u32> = (0..self.vertices.len() as u32).collect();
        let at = |vertex: u32| self.vertices[vertex as usize];
        let low = open.iter().map(|&v| at(v)).fold(DVec3::INFINITY, DVec3::min);
        let used = self.corners.iter().flatten().map(|&v| at(v));
        let (least, most) = used.fold((low, low), |(least, most), p| (least.min(p), most.max(p)));
        let reach = SAME_PLACE * least.distance(most);
        let mut grid: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for &vertex in &open {
            let cell = ((at(vertex) - low) / reach).to_array().map(|x| x.floor() as i64);
            let near = |cell: [i64; 3]| grid.get(&cell).into_iter().flatten().copied();
            let around = (0..27).flat_map(|code| near([0, 1, 2].map(|k| cell[k] + code / [1, 3, 9][k] % 3 - 1)));
            match around.filter(|&other| at(other).distance(at(vertex)) <= reach).min() {
                Some(other) => first[vertex as usize] = other,
                None => grid.entry(cell).or_default().push(vertex),
            }
        }
        first
    }
}

fn is_flat([a, b, c]: [DVec3; 3]) -> bool {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    (b - a).cross(c - a).length() <= THINNEST * longest
}
