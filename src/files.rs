//! Reading of files that a user names. Only regular files are read (no folders, and no pipes or devices, whose contents
//! may never end), and only up to a size that leaves memory for the work itself.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::{Error, Result, memory};

/// Greatest size of a file of text (scene, skeleton, trajectory, curve, results), bytes.
pub const MOST_TEXT: u64 = 64 << 20;
/// Greatest size of a mesh file, bytes: some eight million vertices of a surface.
pub const MOST_MESH: u64 = 512 << 20;

/// The files that have been opened since [`forget_inputs`].
static INPUTS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn inputs() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    INPUTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether a file has been opened here since [`forget_inputs`]: a command does not write over what it reads.
pub fn is_input(path: &Path) -> bool {
    path.canonicalize().is_ok_and(|path| inputs().contains(&path))
}

/// Reads something without counting its files among the inputs.
pub fn unnoticed<T>(read: impl FnOnce() -> T) -> T {
    let before = inputs().clone();
    let read = read();
    *inputs() = before;
    read
}

/// Counts a file among the inputs before it is opened.
pub fn will_read(path: &Path) {
    if let Ok(path) = path.canonicalize() {
        inputs().insert(path);
    }
}

/// Forgets which files were opened; called where a command begins.
pub fn forget_inputs() {
    inputs().clear();
}

/// The extension of a file's name, in lower case; empty where there is none.
pub fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Opens a regular file. An error names the file, and ends with `remedy`.
pub fn open(path: &Path, remedy: &str) -> Result<File> {
    let failed = |problem: String| Error::input(path, None, problem, remedy);
    // A pipe must not be opened: that would wait for somebody to write into it.
    if let Some(problem) = irregular(path) {
        return Err(failed(problem.into()));
    }
    let file = File::open(path).map_err(|error| failed(format!("cannot be read: {error}")))?;
    will_read(path);
    Ok(file)
}

/// Reads a regular file of at most `most` bytes. An error names the file, and ends with `remedy`.
pub fn bytes(path: &Path, most: u64, remedy: &str) -> Result<Vec<u8>> {
    let failed = |problem: String| Error::input(path, None, problem, remedy);
    let mut bytes = Vec::new();
    let read = open(path, remedy)?.take(most + 1).read_to_end(&mut bytes);
    read.map_err(|error| failed(format!("cannot be read: {error}")))?;
    if bytes.len() as u64 > most {
        return Err(failed(format!("is larger than {} MiB, the most that is read", most >> 20)));
    }
    Ok(bytes)
}

/// Reads a mesh file of at most [`MOST_MESH`] bytes, if the system gives memory for the work on it too. An error names
/// the file, and ends with `remedy`.
pub fn mesh(path: &Path, remedy: &str) -> Result<Vec<u8>> {
    let bytes = bytes(path, MOST_MESH, remedy)?;
    memory::ask(memory::BYTES_PER_BYTE_OF_MESH * bytes.len() as f64)
        .map_err(|problem| Error::input(path, None, problem, "give a mesh with fewer vertices, or free memory"))?;
    Ok(bytes)
}

/// Reads a regular file of at most [`MOST_TEXT`] bytes of UTF-8. An error names the file, and ends with `remedy`.
pub fn text(path: &Path, remedy: &str) -> Result<String> {
    String::from_utf8(bytes(path, MOST_TEXT, remedy)?).map_err(|error| {
        let good = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = good.iter().filter(|byte| **byte == b'\n').count() + 1;
        Error::input(path, Some(line), "is not UTF-8", remedy)
    })
}

/// Why a path that exists is no regular file; `None` for a regular file, and for a path at which nothing is.
pub fn irregular(path: &Path) -> Option<&'static str> {
    let kind = fs::metadata(path).ok()?.file_type();
    match (kind.is_file(), kind.is_dir()) {
        (true, _) => None,
        (_, true) => Some("is a folder, not a file"),
        _ => Some("is a pipe or a device, not a regular file, and might never end"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(path: &Path) -> String {
        bytes(path, MOST_TEXT, "give a scene").unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_regular_file_is_refused_unread() {
        let folder = tempfile::tempdir().unwrap();
        assert!(said(folder.path()).ends_with("is a folder, not a file; give a scene"));
        assert!(said(&folder.path().join("none")).contains("cannot be read"));
        #[cfg(unix)]
        {
            assert!(said(Path::new("/dev/zero")).contains("a pipe or a device"));
            let pipe = folder.path().join("pipe");
            std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
            assert!(said(&pipe).contains("a pipe or a device"));
        }
    }

    #[test]
    fn what_was_read_is_known_by_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let [read, other] = ["read", "other"].map(|name| folder.path().join(name));
        for path in [&read, &other] {
            fs::write(path, "x").unwrap();
        }
        bytes(&read, MOST_TEXT, "").unwrap();
        assert!(is_input(&read) && is_input(&folder.path().join(".").join("read")));
        assert!(!is_input(&other) && !is_input(&folder.path().join("none")));
    }

    #[test]
    fn a_file_that_is_too_large_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        let file = File::create(&path).unwrap();
        file.set_len(MOST_TEXT).unwrap();
        assert_eq!(bytes(&path, MOST_TEXT, "").unwrap().len() as u64, MOST_TEXT);
        file.set_len(1 << 40).unwrap();
        assert!(said(&path).contains("is larger than 64 MiB"));
    }

    #[test]
    fn text_that_is_none_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        fs::write(&path, b"one\ntwo \xff\n").unwrap();
        assert!(
            text(&path, "save it as UTF-8")
                .unwrap_err()
                .to_string()
                .ends_with("text:2: is not UTF-8; save it as UTF-8")
        );
    }
}
