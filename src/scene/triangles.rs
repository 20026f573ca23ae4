//! Reads triangle meshes of every supported format: the skin (surface mesh) of a body, or the surface of the tool (the
//! rigid body that the haptic device leads). Polygons are cut into triangles; colours, normals and textures are not
//! read.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::triangulate::triangulate;
use super::{gltf, obj, ply, stl, vtk, vtk_xml};
use crate::files::extension;
use crate::{Error, Result};

/// Extensions of the files that [`read`] can read.
pub const EXTENSIONS: [&str; 8] = ["obj", "stl", "ply", "gltf", "glb", "vtp", "vtu", "vtk"];

/// Greatest number of triangles, and of vertices, of a file that repeats its data; others are limited by their size.
pub(super) const MOST_TRIANGLES: usize = 10_000_000;
/// Greatest number of corners of a polygon; cutting a concave one takes time in proportion to its square.
const MOST_CORNERS: usize = 4096;

/// A triangle mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TriangleMesh {
    /// The positions of all vertices, used or not, in the coordinates of the file. They are in the order of the file;
    /// those of an STL file, which gives each triangle corners of its own, in the order in which they first occur.
    pub vertices: Vec<DVec3>,
    /// Zero-based indices of the three vertices of each triangle. Triangles are in the order of the file's faces; a
    /// face with more than three vertices gives several triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle mesh that was read from a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleFile {
    /// The mesh.
    pub mesh: TriangleMesh,
    /// Notes on parts of the file that were left out; one sentence for each.
    pub notes: Vec<String>,
}

/// Returns the files that [`read`] reads for `path`: the file itself, and the buffers that a glTF file names.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let mut files = vec![path.to_path_buf()];
    if extension(path) == "gltf" {
        files.extend(gltf::buffers(path));
    }
    files
}

/// Reads a surface in the format that its extension names: Wavefront `.obj`, `.stl`, `.ply`, glTF `.gltf` and `.glb`,
/// VTK `.vtp`, `.vtu` and legacy `.vtk`.
///
/// In the result every coordinate is finite, every index is that of a vertex, and at least one triangle has an area
/// above zero. [`crate::prepare::repair`] decides whether the surface can serve as a skin. An error names the line (of a
/// text file), the byte (of a binary file) or the element.
pub fn read(path: &Path) -> Result<TriangleFile> {
    let file = match extension(path).as_str() {
        "obj" => TriangleFile { mesh: obj::read(path)?, notes: Vec::new() },
        "stl" => stl::read(path)?,
        "ply" => ply::read(path)?,
        "gltf" | "glb" => gltf::read(path)?,
        "vtp" | "vtu" => vtk_xml::read_surface(path)?,
        "vtk" => vtk::read_surface(path)?,
        _ => {
            let remedy = format!("give .{}", EXTENSIONS.join(", ."));
            return Err(Error::input(path, None, "has no extension of a supported surface", remedy));
        }
    };
    let problem = match (file.mesh.vertices.is_empty(), file.mesh.triangles.is_empty()) {
        (true, _) => "has no vertices",
        (_, true) => "has no faces",
        _ if !has_area(&file.mesh) => "no face has any area",
        _ => return Ok(file),
    };
    Err(Error::input(path, None, problem, "export the surface with its faces again"))
}

/// Returns, for each triangle of a text file in which each face has a line of its own, the one-based number of that
/// line; `None` for files of other formats.
pub(crate) fn lines(path: &Path) -> Option<Vec<u32>> {
    if extension(path) == "obj" { obj::triangle_lines(path).ok() } else { None }
}

/// Whether any triangle has an area above zero.
pub(super) fn has_area(mesh: &TriangleMesh) -> bool {
    mesh.triangles.iter().any(|corners| {
        let [a, b, c] = corners.map(|vertex| mesh.vertices[vertex as usize]);
        (b - a).cross(c - a).length_squared() > 0.0
    })
}

/// A mesh to which polygons are added one by one.
pub(super) struct Polygons {
    mesh: TriangleMesh,
}

impl Polygons {
    pub fn new(vertices: Vec<DVec3>) -> Polygons {
        Polygons { mesh: TriangleMesh { vertices, triangles: Vec::new() } }
    }

    /// Adds a polygon, cut into triangles. The caller puts the polygon before the error's text.
    pub fn add(&mut self, corners: &[u64]) -> std::result::Result<(), String> {
        if corners.len() > MOST_CORNERS {
            return Err(format!("has {} vertices; at most {MOST_CORNERS} are cut into triangles", corners.len()));
        }
        let corners = self.checked(corners)?;
        triangulate(&self.mesh.vertices, &corners, &mut self.mesh.triangles);
        Ok(())
    }

    /// Adds the triangles of a strip, in which each vertex makes a triangle with the two before it.
    pub fn add_strip(&mut self, corners: &[u64]) -> std::result::Result<(), String> {
        let corners = self.checked(corners)?;
        let turned = |(k, c): (usize, &[u32])| if k % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] };
        self.mesh.triangles.extend(corners.windows(3).enumerate().map(turned));
        Ok(())
    }

    fn checked(&self, corners: &[u64]) -> std::result::Result<Vec<u32>, String> {
        let count = self.mesh.vertices.len();
        if corners.len() < 3 {
            return Err(format!("has {} vertices; three are the least", corners.len()));
        }
        match corners.iter().find(|corner| **corner >= count as u64) {
            Some(bad) => Err(format!("names vertex {bad}, but there are {count} vertices, counted from 0")),
            None => Ok(corners.iter().map(|corner| *corner as u32).collect()),
        }
    }

    pub fn into_mesh(self) -> TriangleMesh {
        self.mesh
    }
}
