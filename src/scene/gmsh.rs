//! Stand-in reader of Gmsh files, ASCII 2.2 only.

use std::path::Path;

use glam::DVec3;

use crate::{Error, Result};

/// A tetrahedral mesh as in its file.
#[derive(Debug, Clone, Default)]
pub struct TetMesh {
    /// Positions, in file order.
    pub nodes: Vec<DVec3>,
    /// Zero-based nodes.
    pub tetrahedra: Vec<[u32; 4]>,
}

/// Reads a file with node identifiers 1 to N.
pub fn read(path: &Path) -> Result<TetMesh> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::input(path, None, e.to_string(), "check the path"))?;
    let mut mesh = TetMesh::default();
    let mut section = "";
    for line in text.lines() {
        let w: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        match (section, w.as_slice()) {
            ("$Nodes", [_, x, y, z]) => mesh.nodes.push(DVec3::new(*x, *y, *z)),
            ("$Elements", [_, kind, ..]) if *kind == 4.0 => {
                mesh.tetrahedra.push(std::array::from_fn(|k| w[w.len() - 4 + k] as u32 - 1));
            }
            _ if line.starts_with('$') => section = line.trim(),
            _ => {}
        }
    }
    Ok(mesh)
}
