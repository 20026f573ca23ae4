//! Stand-in reader of OBJ files: `v` and `f` lines only.

use std::path::Path;

use glam::DVec3;

use crate::{Error, Result};

/// A triangle mesh as in its file.
#[derive(Debug, Clone, Default)]
pub struct TriangleMesh {
    /// Positions, in order of the file's `v` lines.
    pub vertices: Vec<DVec3>,
    /// Zero-based corners.
    pub triangles: Vec<[u32; 3]>,
}

/// Reads a file.
pub fn read(path: &Path) -> Result<TriangleMesh> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::input(path, None, e.to_string(), "check the path"))?;
    let mut mesh = TriangleMesh::default();
    for (n, line) in text.lines().enumerate() {
        let bad = || Error::input(path, Some(n + 1), "not understood", "mend the line");
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let v: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
                mesh.vertices.push(DVec3::from_slice(v.get(..3).ok_or_else(bad)?));
            }
            Some("f") => {
                let f: Vec<u32> =
                    words.filter_map(|w| w.split('/').next()?.parse::<u32>().ok()).map(|i| i - 1).collect();
                (2..f.len()).for_each(|k| mesh.triangles.push([f[0], f[k - 1], f[k]]));
            }
            _ => {}
        }
    }
    Ok(mesh)
}

/// Nothing yet.
pub fn check_solid(_mesh: &TriangleMesh, _path: &Path) -> Result<()> {
    Ok(())
}
