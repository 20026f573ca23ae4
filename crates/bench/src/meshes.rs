//! Meshes that a benchmark generates. They are written into files in a temporary folder, because scenes name the files
//! of their meshes.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use palpate::scene::{gmsh, obj};
use palpate::{Error, Result};
use tempfile::TempDir;

/// Vertices of a surface (m), and its triangles, wound outward.
pub type Surface = (Vec<DVec3>, Vec<[u32; 3]>);

/// A temporary folder for mesh files, which is deleted with its files when this value is dropped.
#[derive(Debug)]
pub struct MeshFolder(TempDir);

impl MeshFolder {
    /// Makes a new folder. Errors: it cannot be made.
    pub fn new() -> Result<MeshFolder> {
        let made = TempDir::with_prefix("palpate-");
        made.map(MeshFolder).map_err(|error| failed(&std::env::temp_dir(), &error))
    }

    /// Writes a surface in the OBJ format, into the file `name`.obj; returns the file's path.
    pub fn surface(&self, name: &str, (vertices, triangles): &Surface) -> Result<PathBuf> {
        self.write(&format!("{name}.obj"), |w| obj::write(w, vertices, triangles))
    }

    /// Writes the tetrahedral mesh of a soft body (its layer) in Gmsh's format, into the file `name`.msh; returns the
    /// file's path.
    pub fn layer(&self, name: &str, nodes: &[DVec3], tetrahedra: &[[u32; 4]]) -> Result<PathBuf> {
        self.write(&format!("{name}.msh"), |w| gmsh::write(w, nodes, tetrahedra))
    }

    fn write(&self, name: &str, put: impl Fn(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<PathBuf> {
        let path = self.0.path().join(name);
        let written = File::create(&path).and_then(|file| {
            let mut w = BufWriter::new(file);
            put(&mut w)?;
            w.flush()
        });
        written.map_err(|error| failed(&path, &error))?;
        Ok(path)
    }
}

fn failed(path: &Path, error: &std::io::Error) -> Error {
    Error::input(path, None, format!("cannot be written: {error}"), "let TMPDIR name a folder with room")
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::layer::kuhn_box;

    use super::*;

    #[test]
    fn a_folder_goes_with_its_value() {
        let folder = MeshFolder::new().unwrap();
        let layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [2, 1, 2]);
        let path = folder.layer("b", &layer.nodes, &layer.tetrahedra).unwrap();
        assert_eq!(gmsh::read(&path).unwrap().tetrahedra, layer.tetrahedra);
        drop(folder);
        assert!(!path.exists());
    }
}
