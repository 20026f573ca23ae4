//! Finds the folder of real meshes, which are not part of this repository, for tests that run only on request (ignored
//! tests).

use std::path::{Path, PathBuf};

/// The folder of the meshes: the one that the environment variable `PALPATE_MESHES` names, or `shared/meshes` in the
/// parent folder of the repository if the variable is not set. Returns `None` if the variable is `none`: the caller
/// then skips its test. If the folder does not exist, the test fails.
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
        "no meshes in {}: name their folder in PALPATE_MESHES, or set PALPATE_MESHES=none to skip these tests",
        folder.display()
    );
    Some(folder)
}
