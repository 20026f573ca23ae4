//! The Markdown pages of the repository that are checked and whose commands are executed: those at its root, and those
//! of the book in docs/. The test of the book's commands (crates/cli/tests/book) uses this file as well.

use std::io;
use std::path::{Path, PathBuf};

/// Pages at the root of the repository, which do not belong to the book.
const OUTSIDE: [&str; 4] = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"];

/// The files of all pages of the repository in `root`, in the order of their names.
pub fn files(root: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found: Vec<PathBuf> = OUTSIDE.iter().map(|name| root.join(name)).filter(|file| file.exists()).collect();
    let mut folders = vec![root.join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}
