//! From any triangle mesh to a skin: what is wrong with a surface, and what is done about it.
//!
//! Depth is measured between the insides of two skins, so each must have one. [`repair`] joins faces that only touch,
//! drops faces that say nothing, turns faces and pieces outwards, tolerates holes, edges of many faces and crossings,
//! and refuses what has no inside. All of it is counted in a [`RepairReport`]; [`strict`] refuses what [`repair`]
//! would have mended, so that both rest on one mechanism. Vertices keep their order and number: the skin's vertex i is
//! the file's i-th `v` line, and only faces are given other indices.

mod crossings;
mod faces;
mod outside;
mod report;
mod topology;

use std::path::Path;

use glam::DVec3;

pub use outside::closed;
pub use report::{Count, Crossings, RepairReport};

use crate::scene::obj::{self, TriangleMesh};
use crate::{Error, Result};
use faces::Faces;

/// A surface that cannot be a skin: what is wrong, at which triangle of the file first, and what to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// What is wrong.
    pub problem: String,
    /// The first triangle it is seen at, in the order of the file.
    pub triangle: Option<usize>,
    /// What the user can do.
    pub remedy: &'static str,
}

impl Refusal {
    /// As an error about the file that the mesh was read from.
    pub fn error(&self, path: &Path) -> Error {
        let line = self.triangle.and_then(|triangle| line_of(path, triangle));
        Error::input(path, line, self.placed(), self.remedy)
    }

    /// What is wrong, and at which triangle.
    pub fn placed(&self) -> String {
        let place = self.triangle.map(|triangle| format!(", first at triangle {triangle}")).unwrap_or_default();
        format!("{}{place}", self.problem)
    }
}

/// The one-based line of the file that a triangle came from.
fn line_of(path: &Path, triangle: usize) -> Option<usize> {
    obj::triangle_lines(path).ok()?.get(triangle).map(|&line| line as usize)
}

/// Makes a skin of a mesh in file coordinates. In order:
///
/// 1. faces that name no vertex and coordinates that single precision cannot hold are refused;
/// 2. triangles without area and triangles given again (either way round) are dropped, and vertices at open edges that
///    coincide are joined (faces go to the first of them), until nothing changes;
/// 3. triangles are turned so that neighbours over an edge of two agree, the smaller number giving way; a surface with
///    one side only is refused;
/// 4. each piece (connected over edges of two) that is inside out is turned, holes closed by fans for its volume; a
///    cavity, one within another piece by the generalised winding number (Jacobson, Kavan and Sorkine-Hornung 2013),
///    goes the way of the piece around it; sheets without volume stay as they are;
/// 5. a mesh without volume, or with more hole than surface, is refused.
///
/// Open edges, edges of more than two triangles and crossing triangles stay and are counted. A sound mesh comes back
/// unchanged, bit by bit. Time is near-linear in the triangles.
pub fn repair(mesh: TriangleMesh) -> std::result::Result<(TriangleMesh, RepairReport), Refusal> {
    let mut report = RepairReport::of(&mesh);
    let mesh = mend(mesh, &mut report)?;
    Ok((mesh, report))
}

/// Accepts a mesh that [`repair`] leaves alone, and refuses any other with what is wrong. Crossing triangles, cavities
/// and unused vertices are allowed: inside is where any piece says so.
pub fn strict(mesh: TriangleMesh) -> std::result::Result<(TriangleMesh, RepairReport), Refusal> {
    let mut report = RepairReport::of(&mesh);
    let mesh = mend(mesh, &mut report).map_err(|refusal| report.dropped().unwrap_or(refusal))?;
    report.defect().map_or(Ok((mesh, report)), Err)
}

fn mend(mesh: TriangleMesh, report: &mut RepairReport) -> std::result::Result<TriangleMesh, Refusal> {
    faces::check(&mesh)?;
    let TriangleMesh { vertices, triangles } = mesh;
    let mut faces = Faces::new(&vertices, triangles);
    faces.clean(report);
    outside::orient(&mut faces, report)?;
    report.self_intersections = crossings::count(&faces);
    report.triangles_kept = faces.corners.len();
    let triangles = faces.corners;
    Ok(TriangleMesh { vertices, triangles })
}

/// Where a triangle of a repaired mesh comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// The triangle, in the order of the file.
    pub triangle: u32,
    /// Whether its second and third corner changed places.
    pub is_turned: bool,
}

/// Where each triangle comes from that [`repair`] makes of a mesh.
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

/// Reads an OBJ file, and repairs it, or refuses what would need it (`mends` false).
pub fn read(path: &Path, mends: bool) -> Result<(TriangleMesh, RepairReport)> {
    let mesh = obj::read(path)?;
    let made = if mends { repair(mesh) } else { strict(mesh) };
    made.map_err(|refusal| refusal.error(path))
}

/// What was done to a file, a sentence each, for people: `FILE:LINE: what was done`.
pub fn notes(report: &RepairReport, path: &Path) -> Vec<String> {
    let lines = if report.is_clean() { None } else { obj::triangle_lines(path).ok() };
    let line = |triangle: usize| lines.as_ref()?.get(triangle).copied();
    let note = |(first, text): (Option<usize>, String)| {
        let place = first.and_then(line).map(|line| format!(":{line}")).unwrap_or_default();
        format!("{}{place}: {text}", path.display())
    };
    report.sentences().into_iter().map(note).collect()
}

/// Corners of a triangle.
fn points(vertices: &[DVec3], triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|vertex| vertices[vertex as usize])
}

#[cfg(test)]
mod tests;
