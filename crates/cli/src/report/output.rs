//! A directory of results, whose files appear all together or not at all.
//!
//! Files are written into a hidden folder inside the directory and moved to their names by [`Output::commit`]. If an
//! [`Output`] is dropped without a commit, nothing is left, not even the directory if it was made for the run. A killed
//! process can leave the hidden folder, but never a half-written result.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use palpate::{Error, Result};

/// Files that are being written into a directory.
pub struct Output {
    directory: PathBuf,
    hidden: PathBuf,
    /// Directories made for this run, outermost first.
    made: Vec<PathBuf>,
    names: Vec<String>,
    is_committed: bool,
}

impl Output {
    /// Prepares to write into `directory`, which is made where it does not exist.
    pub fn create(directory: &Path) -> Result<Self> {
        let hidden = directory.join(format!(".palpate-{}", std::process::id()));
        let missing = directory.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let mut made: Vec<PathBuf> = missing.map(Into::into).collect();
        made.reverse();
        let output = Output { directory: directory.into(), hidden, made, names: Vec::new(), is_committed: false };
        fs::create_dir_all(&output.hidden).map_err(|source| Error::Output { file: directory.into(), source })?;
        Ok(output)
    }

    /// A new file that will be called `name`.
    pub fn file(&mut self, name: &str) -> Result<BufWriter<File>> {
        let failed = |source| Error::Output { file: self.path(name), source };
        // A directory of this name is refused here, because at the commit other files may already have their final
        // names.
        if self.path(name).is_dir() {
            return Err(failed(std::io::ErrorKind::IsADirectory.into()));
        }
        let file = File::create(self.hidden.join(name)).map_err(failed)?;
        self.names.push(name.into());
        Ok(BufWriter::new(file))
    }

    /// Writes a whole file that will be called `name`.
    pub fn write(
        &mut self,
        name: &str,
        contents: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
    ) -> Result<()> {
        let mut file = self.file(name)?;
        contents(&mut file)
            .and_then(|()| file.flush())
            .map_err(|source| Error::Output { file: self.path(name), source })
    }

    /// Opens a file of this output that was written already, to read it.
    pub fn read(&self, name: &str) -> Result<File> {
        File::open(self.hidden.join(name)).map_err(|source| Error::Output { file: self.path(name), source })
    }

    /// Path at which a file called `name` will be after the commit.
    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.join(name)
    }

    /// Moves every file to its final name, in the order in which the files were made; older files of these names are
    /// replaced.
    pub fn commit(mut self) -> Result<()> {
        for name in &self.names {
            let target = self.path(name);
            fs::rename(self.hidden.join(name), &target).map_err(|source| Error::Output { file: target, source })?;
        }
        self.is_committed = true;
        Ok(())
    }
}

impl Drop for Output {
    /// Removes the hidden folder, and without a commit also those directories made for the run that are empty. What
    /// cannot be removed stays, and is not an error.
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.hidden);
        if !self.is_committed {
            for directory in self.made.iter().rev() {
                let _ = fs::remove_dir(directory);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_appear_at_commit_and_not_before() {
        let root = tempfile::tempdir().unwrap();
        let directory = root.path().join("a/b");
        let mut output = Output::create(&directory).unwrap();
        output.write("x.csv", |w| writeln!(w, "new")).unwrap();
        output.write("y.csv", |w| writeln!(w, "y")).unwrap();
        assert_eq!(std::io::read_to_string(output.read("x.csv").unwrap()).unwrap(), "new\n");
        fs::write(directory.join("x.csv"), "old").unwrap();
        assert!(!directory.join("y.csv").exists());
        output.commit().unwrap();
        assert_eq!(names(&directory), ["x.csv", "y.csv"]);
        assert_eq!(fs::read_to_string(directory.join("x.csv")).unwrap(), "new\n");
    }

    #[test]
    fn dropped_it_leaves_nothing_of_its_own() {
        let root = tempfile::tempdir().unwrap();
        let mut output = Output::create(&root.path().join("a/b")).unwrap();
        output.write("x.csv", |w| writeln!(w, "x")).unwrap();
        drop(output);
        assert!(names(root.path()).is_empty());
        fs::write(root.path().join("mine"), "").unwrap();
        drop(Output::create(root.path()).unwrap());
        assert_eq!(names(root.path()), ["mine"]);
    }

    #[test]
    fn a_folder_in_a_files_place_is_an_error_before_anything_is_written() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join("y.csv")).unwrap();
        let mut output = Output::create(root.path()).unwrap();
        output.write("x.csv", |w| writeln!(w, "x")).unwrap();
        assert!(output.write("y.csv", |w| writeln!(w, "y")).unwrap_err().to_string().contains("y.csv"));
        drop(output);
        assert_eq!(names(root.path()), ["y.csv"]);
    }

    #[test]
    fn a_directory_that_cannot_be_is_an_error_that_names_it() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("file"), "").unwrap();
        let error = Output::create(&root.path().join("file/under")).err().unwrap().to_string();
        assert!(error.contains("file/under"), "wrong error: {error}");
        assert_eq!(names(root.path()), ["file"]);
    }
}
