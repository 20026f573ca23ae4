//! What the fuzz targets share: files in memory with the bytes that the fuzzer gives, and small scenes.

use std::cell::RefCell;
use std::path::Path;

use palpate::Scene;
use palpate::scene::{tetrahedra, triangles};
use tempfile::TempDir;

thread_local! {
    static FOLDER: RefCell<Option<TempDir>> = const { RefCell::new(None) };
}

/// Calls `work` with a folder that lives as long as the process, in memory where the system has such a file system.
pub fn in_folder<T>(work: impl FnOnce(&Path) -> T) -> T {
    FOLDER.with_borrow_mut(|folder| {
        let memory = Path::new("/dev/shm");
        let made = || if memory.is_dir() { TempDir::new_in(memory) } else { TempDir::new() };
        work(folder.get_or_insert_with(|| made().expect("a temporary folder")).path())
    })
}

/// Writes the bytes into a file of this name, and calls `work` with its path.
pub fn in_file<T>(name: &str, bytes: &[u8], work: impl FnOnce(&Path) -> T) -> T {
    in_folder(|folder| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).expect("a file in the temporary folder");
        work(&path)
    })
}

/// Requires that an error is one line without control characters.
pub fn fair<T>(result: palpate::Result<T>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let text = error.to_string();
            assert!(!text.is_empty() && !text.contains(|c: char| c.is_control() && c != '\t'), "{text:?}");
            None
        }
    }
}

/// Reads a surface from a file of this name, and requires that an accepted one is sound.
pub fn surface(name: &str, bytes: &[u8]) {
    let Some(mesh) = fair(in_file(name, bytes, triangles::read)).map(|file| file.mesh) else { return };
    let count = mesh.vertices.len() as u32;
    assert!(mesh.vertices.iter().all(|vertex| vertex.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|vertex| *vertex < count));
}

/// Reads a tetrahedral mesh from a file of this name, and requires that an accepted one is sound.
pub fn layer(name: &str, bytes: &[u8]) {
    let Some(mesh) = fair(in_file(name, bytes, tetrahedra::read)) else { return };
    let count = mesh.nodes.len() as u32;
    assert!(mesh.nodes.iter().all(|node| node.is_finite()));
    assert!(mesh.tetrahedra.iter().flatten().all(|node| *node < count));
}

/// The scene of a text, as if from a file in `folder`.
pub fn scene(folder: &Path, text: &str) -> palpate::Result<Scene> {
    Scene::parse(&folder.join("scene.toml"), text)
}
