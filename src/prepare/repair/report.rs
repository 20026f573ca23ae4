//! Report on the repair of a surface, by which the surface becomes the skin of a body: for each kind of defect the
//! number of occurrences and the first triangle that has it, and sentences for the user. To *reverse* a triangle is to
//! exchange two of its corners, so that it faces the other way.

use serde::{Deserialize, Serialize};

use super::Refusal;
use crate::scene::triangles::TriangleMesh;

/// Number of occurrences of a defect, and the first triangle that has it (index in the file, from 0).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Count {
    /// Number of occurrences.
    pub count: usize,
    /// The first triangle that has the defect, if there is one.
    pub first_triangle: Option<usize>,
}

impl Count {
    /// Adds an occurrence at this triangle of the file.
    pub(super) fn add(&mut self, triangle: usize) {
        self.count += 1;
        self.first_triangle = Some(self.first_triangle.map_or(triangle, |first| first.min(triangle)));
    }
}

/// Pairs of triangles that intersect.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Intersections {
    /// Number of pairs.
    pub count: usize,
    /// The first pairs (indices of triangles in the file, from 0), in ascending order.
    pub first_pairs: Vec<[usize; 2]>,
}

/// State of a surface, its defects, and the changes made to it. Lengths are in the coordinates of the surface's file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RepairReport {
    /// Number of vertices of the file, used or not.
    pub vertices: usize,
    /// Number of triangles of the file, after polygons are triangulated.
    pub triangles: usize,
    /// Number of triangles of the skin, which is the repaired surface.
    pub triangles_kept: usize,
    /// Number of vertices that no triangle of the file uses; they move to a corner of the first triangle.
    pub unused_vertices: usize,
    /// Vertices at open edges (edges with one triangle) that coincide with an earlier vertex: faces now use the earlier
    /// vertex.
    pub welded_vertices: Count,
    /// Triangles without area, which are removed.
    pub zero_area: Count,
    /// Triangles with the same vertices as an earlier one, in either orientation; they are removed.
    pub duplicates: Count,
    /// Edges whose two triangles were oriented inconsistently.
    pub clashing_edges: Count,
    /// Number of triangles that were reversed to be consistent with their neighbours.
    pub turned_triangles: usize,
    /// Number of pieces: parts of the surface that are connected across edges with two triangles.
    pub pieces: usize,
    /// Pieces that were inside out and were reversed.
    pub turned_pieces: Count,
    /// Number of cavities: pieces that lie inside another piece and are oriented inwards after the repair.
    pub cavities: usize,
    /// Pieces without volume, which are kept as they are.
    pub sheets: Count,
    /// Edges with one triangle, which are left open.
    pub boundary_edges: Count,
    /// Number of holes, counted by their rims: a rim is a set of edges with one triangle that are connected at
    /// vertices.
    pub holes: usize,
    /// Area of the triangle fans that close the holes for volume and mass, as a share of the surface's area.
    pub hole_area_share: f64,
    /// Edges with more than two triangles: across such an edge no triangle has a neighbour.
    pub non_manifold_edges: Count,
    /// Pairs of triangles that intersect; triangles that only touch are not counted.
    pub self_intersections: Intersections,
    /// Volume with holes closed by triangle fans, in the cube of the file's unit of length.
    pub volume: f64,
}

impl RepairReport {
    /// The report of a mesh before the repair.
    pub(super) fn of(mesh: &TriangleMesh) -> Self {
        RepairReport {
            vertices: mesh.vertices.len(),
            triangles: mesh.triangles.len(),
            unused_vertices: super::are_used(mesh).iter().filter(|is_used| !**is_used).count(),
            ..Default::default()
        }
    }

    /// Whether there is nothing to tell the user: no defect was found, and nothing was changed.
    pub fn is_clean(&self) -> bool {
        self.sentences().is_empty()
    }

    /// The first reason to refuse the surface, for a caller who does not allow repairs; `None` if there is no reason.
    pub(super) fn defect(&self) -> Option<Refusal> {
        let open = format!("the surface is open: {} edges with one triangle", self.boundary_edges.count);
        let sheets = format!("{} pieces of the surface enclose no volume", self.sheets.count);
        let clashing = format!("{} edges with inconsistently oriented triangles", self.clashing_edges.count);
        let crowded = format!("{} edges with more than two triangles", self.non_manifold_edges.count);
        self.dropped()
            .or(refuse(self.non_manifold_edges, crowded, "make the surface manifold: separate the pieces there"))
            .or(refuse(self.clashing_edges, clashing, "make all faces point outwards (\"recalculate normals\")"))
            .or(refuse(self.boundary_edges, open, "close the holes"))
            .or(refuse(self.sheets, sheets, "remove them, or give them thickness"))
            .or(refuse(self.turned_pieces, "the surface is inside out".into(), "reverse its faces (\"flip normals\")"))
    }

    /// A reason to refuse the surface if it has a defect for which the repair removes faces or merges vertices: the
    /// first such defect.
    pub(super) fn dropped(&self) -> Option<Refusal> {
        let flat = format!("{} triangles without area", self.zero_area.count);
        let copies = format!("{} triangles given more than once", self.duplicates.count);
        let apart = format!("{} vertices at open edges coincide with others", self.welded_vertices.count);
        refuse(self.zero_area, flat, "collapse or remove them (\"merge by distance\")")
            .or(refuse(self.duplicates, copies, "remove the copies"))
            .or(refuse(self.welded_vertices, apart, "weld vertices that coincide (\"merge by distance\")"))
    }

    /// Findings and changes, one sentence each, with the first triangle concerned; empty for a sound surface.
    pub(in crate::prepare) fn sentences(&self) -> Vec<(Option<usize>, String)> {
        let mut said = Vec::new();
        if self.unused_vertices > 0 {
            said.push((
                None,
                format!(
                    "{} vertices that no triangle uses moved to a corner of the first triangle",
                    self.unused_vertices
                ),
            ));
        }
        let mut say = |found: Count, text: String| {
            if found.count > 0 {
                said.push((found.first_triangle, format!("{} {text}", found.count)));
            }
        };
        say(self.zero_area, "triangles without area dropped".into());
        say(self.duplicates, "triangles given more than once dropped".into());
        say(self.welded_vertices, "vertices joined with others at the same place, where edges were open".into());
        let turned =
            format!("edges with inconsistently oriented triangles; {} triangles reversed", self.turned_triangles);
        say(self.clashing_edges, turned);
        say(self.turned_pieces, "pieces were inside out, and reversed".into());
        say(self.sheets, "pieces enclose no volume, and are kept as sheets".into());
        let share = 100.0 * self.hole_area_share;
        let open = format!(
            "edges of one triangle around {} holes, left open; for volume and mass, triangle fans close them \
             ({share:.2} % of the surface)",
            self.holes
        );
        say(self.boundary_edges, open);
        say(self.non_manifold_edges, "edges of more than two triangles, kept as they are".into());
        let intersections = &self.self_intersections;
        if let Some(&[a, b]) = intersections.first_pairs.first() {
            let text = format!(
                "{} pairs of triangles intersect, kept; first triangles {a} and {b} (from 0)",
                intersections.count
            );
            said.push((Some(a), text));
        }
        said
    }
}

fn refuse(found: Count, problem: String, remedy: &'static str) -> Option<Refusal> {
    (found.count > 0).then_some(Refusal { problem, triangle: found.first_triangle, remedy })
}
