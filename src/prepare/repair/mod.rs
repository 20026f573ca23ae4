//! Makes a skin (the surface mesh that is seen and touched) of any triangle mesh, before the first step: finds the
//! defects of a surface and repairs them. To *reverse* a triangle is to exchange two of its corners, so that it faces
//! the other way; a *piece* is a part of the surface that is connected across edges with two triangles; an edge is
//! *open* if it has one triangle.
//!
//! Contact depth is the depth of one skin inside another, so each skin must have an inside. [`repair`] merges vertices
//! that coincide at open edges, removes degenerate and duplicate faces, orients faces and pieces outwards, tolerates
//! holes, non-manifold edges and self-intersections, and refuses a surface without an inside. It counts all findings
//! and changes in a [`RepairReport`]. [`strict`] runs the same code and refuses a surface with a defect. Vertices keep
//! their order and number: a vertex of the skin has the index that it has in the file, and only the faces' indices change.

mod faces;
mod intersections;
mod outside;
mod report;
mod topology;

use std::path::Path;

use glam::DVec3;

pub use outside::closed;
pub use report::{Count, Intersections, RepairReport};

use crate::scene::triangles::{self, TriangleMesh};
use crate::{Error, Result};
use faces::Faces;

/// Why a surface cannot be a skin.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// The defect, in words for the user.
    pub problem: String,
    /// The first triangle with the defect, in the order of the file.
    pub triangle: Option<usize>,
    /// What the user can do about the defect.
    pub remedy: &'static str,
}

impl Refusal {
    /// The refusal as an error about the file from which the mesh was read.
    pub fn error(&self, path: &Path) -> Error {
        let line = self.triangle.and_then(|triangle| line_of(path, triangle));
        Error::input(path, line, self.placed(), self.remedy)
    }

    /// The defect, with the first triangle that has it.
    pub fn placed(&self) -> String {
        let place = self.triangle.map(|triangle| format!(", first at triangle {triangle}")).unwrap_or_default();
        format!("{}{place}", self.problem)
    }
}

/// The one-based line of the file from which a triangle was read.
fn line_of(path: &Path, triangle: usize) -> Option<usize> {
    triangles::lines(path)?.get(triangle).map(|&line| line as usize)
}

/// Makes a skin of a mesh in file coordinates, in this order:
///
/// 1. a face with the index of a vertex that does not exist is refused, and so are coordinates that are too large for
///    single precision, or for which the spacing of single-precision numbers is too coarse;
/// 2. triangles without area and duplicate triangles (in either orientation) are removed, and vertices at open edges
///    that coincide are merged (faces then use the first of them), until nothing changes;
/// 3. triangles are reversed until the two triangles of each edge with two triangles are oriented consistently; in each
///    piece the smaller number of triangles is reversed; a surface with one side only is refused;
/// 4. each piece that is inside out (its volume is negative when triangle fans close its holes) is reversed, except
///    that a piece inside another piece (by the generalised winding number; Jacobson, Kavan and Sorkine-Hornung 2013)
///    is reversed if and only if the piece around it was reversed; sheets, which are pieces without volume, stay
///    unchanged;
/// 5. a mesh without volume is refused, and so is a mesh whose holes have more than three quarters of its area;
/// 6. vertices that no triangle of the file uses move to a corner of the first triangle, wherever they were, so that
///    they count neither for the extent of a body nor for the layer around it.
///
/// Open edges, edges of more than two triangles and intersecting triangles stay and are counted. A sound mesh comes
/// back bitwise unchanged. The time is nearly linear in the number of triangles.
pub fn repair(mesh: TriangleMesh) -> std::result::Result<(TriangleMesh, RepairReport), Refusal> {
    let mut report = RepairReport::of(&mesh);
    let mesh = mend(mesh, &mut report)?;
    Ok((mesh, report))
}

/// Accepts a mesh that [`repair`] would not change and that has no open edge, no edge of more than two triangles and no
/// sheet (piece without volume); refuses any other mesh with its first defect. Intersecting triangles and inner
/// pieces that enclose a cavity are allowed; unused vertices move as in [`repair`].
pub fn strict(mesh: TriangleMesh) -> std::result::Result<(TriangleMesh, RepairReport), Refusal> {
    let mut report = RepairReport::of(&mesh);
    let mesh = mend(mesh, &mut report).map_err(|refusal| report.dropped().unwrap_or(refusal))?;
    report.defect().map_or(Ok((mesh, report)), Err)
}

fn mend(mesh: TriangleMesh, report: &mut RepairReport) -> std::result::Result<TriangleMesh, Refusal> {
    faces::check(&mesh)?;
    let TriangleMesh { vertices, triangles } = settle_unused(mesh);
    let mut faces = Faces::new(&vertices, triangles);
    faces.clean(report);
    outside::orient(&mut faces, report)?;
    report.self_intersections = intersections::count(&faces);
    report.triangles_kept = faces.corners.len();
    let triangles = faces.corners;
    Ok(TriangleMesh { vertices, triangles })
}

/// Whether each vertex belongs to a triangle. An index out of range is passed over: [`faces::check`] refuses it.
fn are_used(mesh: &TriangleMesh) -> Vec<bool> {
    let mut used = vec![false; mesh.vertices.len()];
    for &vertex in mesh.triangles.iter().flatten() {
        used.get_mut(vertex as usize).into_iter().for_each(|used| *used = true);
    }
    used
}

/// Moves vertices that no triangle uses to the first corner of the first triangle.
fn settle_unused(mut mesh: TriangleMesh) -> TriangleMesh {
    let corner = mesh.triangles.first().map_or(DVec3::ZERO, |triangle| mesh.vertices[triangle[0] as usize]);
    let are_used = are_used(&mesh);
    let unused = mesh.vertices.iter_mut().zip(are_used).filter(|(_, is_used)| !is_used);
    unused.for_each(|(vertex, _)| *vertex = corner);
    mesh
}

/// Origin of a triangle of a repaired mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// Index of the triangle in the order of the file.
    pub triangle: u32,
    /// Whether the triangle was reversed: its second and third corner are exchanged.
    pub is_turned: bool,
}

/// The origins of the triangles of the mesh that [`repair`] would return.
pub fn origins(mesh: &TriangleMesh) -> std::result::Result<Vec<Origin>, Refusal> {
    faces::check(mesh)?;
    let mut report = RepairReport::of(mesh);
    let mut faces = Faces::new(&mesh.vertices, mesh.triangles.clone());
    faces.clean(&mut report);
    let before = faces.corners.clone();
    outside::orient(&mut faces, &mut report)?;
    let origin = |(t, &triangle): (usize, &usize)| Origin {
        triangle: triangle as u32,
        is_turned: faces.corners[t] != before[t],
    };
    Ok(faces.origin.iter().enumerate().map(origin).collect())
}

/// Reads a file. If `mends` is true, the surface is repaired, otherwise it is refused if it has a defect.
pub fn read(path: &Path, mends: bool) -> Result<(TriangleMesh, RepairReport)> {
    let mesh = triangles::read(path)?.mesh;
    let made = if mends { repair(mesh) } else { strict(mesh) };
    made.map_err(|refusal| refusal.error(path))
}

/// The changes that the repair made, one sentence each for the user: `FILE:LINE: sentence`.
pub fn notes(report: &RepairReport, path: &Path) -> Vec<String> {
    let lines = if report.is_clean() { None } else { triangles::lines(path) };
    let line = |triangle: usize| lines.as_ref()?.get(triangle).copied();
    let note = |(first, text): (Option<usize>, String)| {
        let place = first.and_then(line).map(|line| format!(":{line}")).unwrap_or_default();
        format!("{}{place}: {text}", path.display())
    };
    report.sentences().into_iter().map(note).collect()
}

/// Positions of a triangle's corners.
fn points(vertices: &[DVec3], triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|vertex| vertices[vertex as usize])
}

#[cfg(test)]
mod tests;
