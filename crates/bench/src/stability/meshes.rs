//! Meshes of the matrix that no scene makes by itself: a block with a layer of slivers, a single tetrahedron.

use std::path::PathBuf;

use glam::DVec3;
use palpate::Result;
use palpate::internal::prepare::layer::kuhn_box;

use crate::meshes::MeshFolder;

/// Cells an edge.
const CELLS: u32 = 4;

/// A cube whose second layer of cells is so thin that its tetrahedra have this dihedral angle (degrees) at least.
pub fn slivers(folder: &MeshFolder, angle: f64, edge: f64) -> Result<PathBuf> {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::splat(edge), [3, CELLS, 3]);
    let cell = edge / 3.0;
    let thin = cell * angle.to_radians().tan();
    // Planes at 0, a third, a little above it, two thirds, 1 of the height.
    let heights = [0.0, edge / 3.0, edge / 3.0 + thin, edge * (2.0 / 3.0), edge];
    for node in &mut layer.nodes {
        node.y = heights[(node.y / edge * f64::from(CELLS)).round() as usize];
    }
    folder.layer(&format!("slivers-{angle}"), &layer.nodes, &layer.tetrahedra)
}

/// One tetrahedron with a face in x = 0.
pub fn tetrahedron(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let corners = [DVec3::ZERO, DVec3::Y * edge, DVec3::Z * edge, DVec3::X * edge];
    folder.layer("tetrahedron", &corners, &[[0, 1, 2, 3]])
}
