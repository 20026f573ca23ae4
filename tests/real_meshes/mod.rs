//! Real meshes, which are not part of this repository, for tests that run only if they are asked for.

use std::path::{Path, PathBuf};

/// The folder of the meshes: `PALPATE_MESHES`, or `../shared/meshes` beside the repository. `None` where
/// `PALPATE_MESHES=none` says that there are no meshes; a folder that does not exist fails the test.
pub fn meshes() -> Option<PathBuf> {
    let asked = std::env::var_os("PALPATE_MESHES");
    if asked.as_deref().is_some_and(|asked| asked == "none") {
        return None;
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = here.ancestors().find(|folder| folder.join("shaders").is_dir()).unwrap();
    let folder = asked.map_or(root.join("../shared/meshes"), PathBuf::from);
    assert!(
        folder.is_dir(),
        "no meshes in {}: name their folder in PALPATE_MESHES, or leave out what needs them by PALPATE_MESHES=none",
        folder.display()
    );
    Some(folder)
}
