//! Writes mesh files for the stability matrix (many stiff and extreme simulations, each judged by invariants), for
//! bodies that a scene cannot describe by numbers: a block in which one row of cells is squeezed to slivers (flat
//! tetrahedra), and a single tetrahedron.

use std::path::PathBuf;

use glam::DVec3;
use palpate::Result;
use palpate::internal::prepare::layer::kuhn_box;

use crate::meshes::MeshFolder;

/// Number of cells of the block along y, of which the second is thin.
const CELLS: u32 = 4;

/// Writes a cube of edge `edge` (m) whose second row of cells along y is so thin that the least dihedral angle of its
/// tetrahedra is `angle` (degrees). Returns the path of the file.
pub fn slivers(folder: &MeshFolder, angle: f64, edge: f64) -> Result<PathBuf> {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::splat(edge), [3, CELLS, 3]);
    let cell = edge / 3.0;
    let thin = cell * angle.to_radians().tan();
    // Heights of the planes of nodes, m; the second plane and the third are close together.
    let heights = [0.0, edge / 3.0, edge / 3.0 + thin, edge * (2.0 / 3.0), edge];
    for node in &mut layer.nodes {
        node.y = heights[(node.y / edge * f64::from(CELLS)).round() as usize];
    }
    folder.layer(&format!("slivers-{angle}"), &layer.nodes, &layer.tetrahedra)
}

/// Writes one tetrahedron with a face in the plane x = 0 and three edges of length `edge` (m) along the axes. Returns
/// the path of the file.
pub fn tetrahedron(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let corners = [DVec3::ZERO, DVec3::Y * edge, DVec3::Z * edge, DVec3::X * edge];
    folder.layer("tetrahedron", &corners, &[[0, 1, 2, 3]])
}
