//! A directory of results, whose files appear all together or not at all.
//!
//! Files are written into a hidden folder inside the directory and moved to their names by [`Output::commit`]. If an
//! [`Output`] is dropped without a commit, or a signal ends the program, nothing is left, not even the directory if it
//! was made for the run. A process that is killed (on Windows, interrupted) can leave the hidden folder, but never a
//! half-written result; the next run with the same directory removes it. Two runs cannot write one directory at the same
//! time, but on file systems without locks.

use std::collections::HashSet;
use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use palpate::internal::files;
use palpate::{Error, Result};

use crate::signals::{Temporary, Unfinished};

/// Name of the hidden folder.
const HIDDEN: &str = ".palpate-unfinished";
/// Name of a file in the hidden folder that is locked as long as a run writes there.
const LOCK: &str = "lock";
/// Beginning of the name under which an older file is kept while new ones are moved.
const OLDER: &str = "older-";
/// Number of attempts to make the hidden folder while other runs end and remove theirs.
const ATTEMPTS: u32 = 100;

/// Files that are being written into a directory.
pub struct Output {
    directory: PathBuf,
    hidden: Temporary,
    names: Vec<String>,
    /// Which older files are removed at the commit, by their names.
    replaced: Vec<fn(&str) -> bool>,
}

impl Output {
    /// Prepares to write into `directory`, which is made where it does not exist.
    pub fn create(directory: &Path) -> Result<Self> {
        let failed = |source| Error::Output { file: directory.into(), source };
        if directory.file_name().is_some_and(|name| name == HIDDEN) {
            return Err(failed(io::Error::new(ErrorKind::AlreadyExists, "its name is that of unfinished results")));
        }
        if directory.is_symlink() && !directory.exists() {
            return Err(failed(io::Error::new(ErrorKind::NotFound, "it is a link to nothing")));
        }
        let folder = directory.join(HIDDEN);
        let missing = directory.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let mut made: Vec<PathBuf> = missing.map(Into::into).collect();
        made.reverse();
        let hidden = Temporary::new(|| {
            let lock = fs::create_dir_all(directory).and_then(|()| locked(&folder)).map_err(|source| {
                for folder in made.iter().rev() {
                    let _ = fs::remove_dir(folder);
                }
                failed(source)
            })?;
            Ok((Unfinished { folder, lock: LOCK, made }, lock))
        })?;
        Ok(Output { directory: directory.into(), hidden, names: Vec::new(), replaced: Vec::new() })
    }

    /// Refuses early what [`Output::file`] would refuse later, for names that are known before the work begins.
    pub fn reserve(&self, names: &[&str]) -> Result<()> {
        names
            .iter()
            .map(|name| self.path(name))
            .try_for_each(|file| unharmed(&file).map_err(|source| Error::Output { file, source }))
    }

    /// A new file that will be called `name`.
    pub fn file(&mut self, name: &str) -> Result<BufWriter<File>> {
        let failed = |source| Error::Output { file: self.path(name), source };
        // A directory of this name is refused here, because at the commit other files may already have their final
        // names.
        if self.path(name).is_dir() {
            return Err(failed(std::io::ErrorKind::IsADirectory.into()));
        }
        unharmed(&self.path(name)).map_err(failed)?;
        let file = File::create(self.hidden.folder().join(name)).map_err(failed)?;
        self.names.push(name.into());
        Ok(BufWriter::new(file))
    }

    /// Writes a whole file that will be called `name`.
    pub fn write(&mut self, name: &str, contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
        let mut file = self.file(name)?;
        contents(&mut file)
            .and_then(|()| file.flush())
            .map_err(|source| Error::Output { file: self.path(name), source })
    }

    /// Opens a file of this output that was written already, to read it.
    pub fn read(&self, name: &str) -> Result<File> {
        File::open(self.hidden.folder().join(name)).map_err(|error| self.unreadable(name, &error))
    }

    /// The error that a file of this output cannot be read again.
    pub fn unreadable(&self, name: &str, error: &dyn std::error::Error) -> Error {
        Error::input(&self.path(name), None, format!("cannot be read again: {error}"), "run the command once more")
    }

    /// Lets the commit remove older files of such names too, of which this output has a part: images of an earlier film
    /// would stand among those of this one.
    #[cfg(any(feature = "view", test))]
    pub fn replaces(&mut self, is_replaced: fn(&str) -> bool) {
        self.replaced.push(is_replaced);
    }

    /// Path at which a file called `name` will be after the commit.
    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.join(name)
    }

    /// Moves every file to its final name, in the order in which the files were made; older files of these names are
    /// replaced. If a file cannot be moved, those moved before go back, and the older files too. A process that is killed
    /// meanwhile may leave some files moved, and older files in the hidden folder, which the next run removes.
    pub fn commit(self) -> Result<()> {
        let Output { directory, hidden, names, mut replaced } = self;
        replaced.retain(|is_replaced| names.iter().any(|name| is_replaced(name)));
        hidden.finish(|folder| {
            let place = |name: &String| Place {
                new: folder.join(name),
                older: folder.join(format!("{OLDER}{name}")),
                target: directory.join(name),
            };
            let places: Vec<Place> = names.iter().map(place).collect();
            for Place { target, .. } in &places {
                unharmed(target).map_err(|source| Error::Output { file: target.clone(), source })?;
            }
            for (moved, place) in places.iter().enumerate() {
                if let Err(source) = place.take() {
                    places[..=moved].iter().rev().for_each(Place::give_back);
                    return Err(Error::Output { file: place.target.clone(), source });
                }
            }
            let names: HashSet<&String> = names.iter().collect();
            let older = fs::read_dir(&directory).into_iter().flatten().flatten();
            for entry in older.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file())) {
                let name = entry.file_name().to_string_lossy().into_owned();
                if !names.contains(&name) && replaced.iter().any(|is_replaced| is_replaced(&name)) {
                    // One that cannot be removed stays.
                    let _ = fs::remove_file(entry.path());
                }
            }
            Ok(())
        })
    }
}

/// Refuses to replace a file that this command has read, and what is no regular file: a link would be replaced, and not
/// what it leads to.
fn unharmed(path: &Path) -> io::Result<()> {
    if files::is_input(path) {
        return Err(io::Error::new(ErrorKind::InvalidInput, "this command reads it, and would overwrite it"));
    }
    match path.symlink_metadata() {
        Ok(facts) if !facts.is_file() && !facts.is_dir() => {
            Err(io::Error::new(ErrorKind::AlreadyExists, "it is a link, a pipe or a device, not a file"))
        }
        _ => Ok(()),
    }
}

/// Where a file is written, where it is to be, and where an older file of its name is kept until all files are moved.
struct Place {
    new: PathBuf,
    older: PathBuf,
    target: PathBuf,
}

impl Place {
    fn take(&self) -> io::Result<()> {
        match self.target.symlink_metadata() {
            Ok(facts) if facts.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(_) => fs::rename(&self.target, &self.older)?,
            Err(_) => {}
        }
        fs::rename(&self.new, &self.target)
    }

    /// Undoes what [`Place::take`] did, or did in part. What cannot be undone stays.
    fn give_back(&self) {
        if !self.new.exists() {
            let _ = fs::rename(&self.target, &self.new);
        }
        let _ = fs::rename(&self.older, &self.target);
    }
}

/// Makes the hidden folder and locks it. Of a run that was killed it holds unfinished files, which are removed. Returns
/// the locked file; `None` on a file system without locks.
fn locked(folder: &Path) -> io::Result<Option<File>> {
    let foreign = || io::Error::new(ErrorKind::AlreadyExists, format!("it has a {HIDDEN} that is not this program's"));
    for _ in 0..ATTEMPTS {
        let is_new = match fs::create_dir(folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => false,
            made => made.map(|()| true)?,
        };
        let path = folder.join(LOCK);
        let is_own = is_new || path.is_file() || fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
        if folder.is_symlink() || folder.is_dir() && !is_own {
            return Err(foreign());
        }
        let lock = match File::options().create(true).truncate(false).write(true).open(&path) {
            // Another run has just ended, and removed the folder.
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            Err(error) => {
                let _ = fs::remove_dir(folder);
                return Err(error);
            }
            Ok(lock) => lock,
        };
        let lock = match lock.try_lock() {
            Ok(()) if is_at(&lock, &path) => lock,
            Ok(()) => continue,
            Err(TryLockError::WouldBlock) => {
                return Err(io::Error::new(ErrorKind::ResourceBusy, "another run is writing there now"));
            }
            // Whether what lies there is of a killed run or of one that goes on, nobody knows.
            Err(TryLockError::Error(_)) => return Ok(None),
        };
        if !is_new {
            for entry in fs::read_dir(folder)?.flatten().filter(|entry| entry.file_name() != LOCK) {
                fs::remove_file(entry.path())?;
            }
        }
        return Ok(Some(lock));
    }
    Err(io::Error::new(ErrorKind::ResourceBusy, "other runs write there all the time"))
}

/// Whether the file that was opened is still the one at this path.
fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let (Ok(opened), Ok(there)) = (file.metadata(), fs::metadata(path)) else { return false };
        (opened.dev(), opened.ino()) == (there.dev(), there.ino())
    }
    #[cfg(not(unix))]
    {
        // Here a file that is open cannot be replaced.
        let _ = file;
        path.exists()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(directory: &Path) -> String {
        Output::create(directory).err().unwrap().to_string()
    }

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
    fn what_was_read_and_what_is_no_file_are_not_replaced() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("x.csv"), "read").unwrap();
        let mut output = Output::create(root.path()).unwrap();
        output.write("x.csv", |w| writeln!(w, "x")).unwrap();
        files::bytes(&root.path().join("x.csv"), 100, "").unwrap();
        assert!(output.file("x.csv").unwrap_err().to_string().contains("this command reads it"));
        assert!(output.commit().unwrap_err().to_string().contains("write into another folder"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(root.path().join("none"), root.path().join("link")).unwrap();
            let mut output = Output::create(root.path()).unwrap();
            assert!(output.file("link").unwrap_err().to_string().contains("it is a link"));
        }
        assert_eq!(fs::read_to_string(root.path().join("x.csv")).unwrap(), "read");
    }

    #[test]
    fn older_files_of_a_series_go_with_it() {
        let root = tempfile::tempdir().unwrap();
        for name in ["frame-1.png", "frame-2.png", "mine.png"] {
            fs::write(root.path().join(name), "old").unwrap();
        }
        let is_frame = |name: &str| name.starts_with("frame-");
        let mut output = Output::create(root.path()).unwrap();
        output.write("x.csv", |w| writeln!(w, "x")).unwrap();
        output.replaces(is_frame);
        output.commit().unwrap();
        assert_eq!(names(root.path()), ["frame-1.png", "frame-2.png", "mine.png", "x.csv"]);
        let mut output = Output::create(root.path()).unwrap();
        output.write("frame-1.png", |w| writeln!(w, "new")).unwrap();
        output.replaces(is_frame);
        output.commit().unwrap();
        assert_eq!(names(root.path()), ["frame-1.png", "mine.png", "x.csv"]);
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
    fn a_second_run_is_refused_until_the_first_ends() {
        let root = tempfile::tempdir().unwrap();
        let first = Output::create(root.path()).unwrap();
        let refused = refusal(root.path());
        assert!(refused.contains("another run is writing there now"), "wrong error: {refused}");
        drop(first);
        Output::create(root.path()).unwrap().commit().unwrap();
        assert!(names(root.path()).is_empty());
    }

    #[test]
    fn what_a_killed_run_left_is_removed() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join(HIDDEN)).unwrap();
        for name in ["trace.csv", LOCK] {
            fs::write(root.path().join(HIDDEN).join(name), "half").unwrap();
        }
        let mut output = Output::create(root.path()).unwrap();
        assert_eq!(names(&root.path().join(HIDDEN)), [LOCK]);
        output.write("x.csv", |w| writeln!(w, "x")).unwrap();
        output.commit().unwrap();
        assert_eq!(names(root.path()), ["x.csv"]);
    }

    #[test]
    fn a_folder_of_the_same_name_that_is_not_the_programs_is_left_alone() {
        let root = tempfile::tempdir().unwrap();
        let hidden = root.path().join(HIDDEN);
        fs::create_dir(&hidden).unwrap();
        fs::write(hidden.join("mine"), "").unwrap();
        assert!(refusal(root.path()).contains("that is not this program's"));
        assert!(refusal(&hidden).contains("that of unfinished results"));
        assert_eq!(names(&hidden), ["mine"]);
        #[cfg(unix)]
        {
            fs::remove_dir_all(&hidden).unwrap();
            let elsewhere = tempfile::tempdir().unwrap();
            fs::write(elsewhere.path().join(LOCK), "mine").unwrap();
            std::os::unix::fs::symlink(elsewhere.path(), &hidden).unwrap();
            assert!(refusal(root.path()).contains("that is not this program's"));
            assert_eq!(fs::read_to_string(elsewhere.path().join(LOCK)).unwrap(), "mine");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_nothing_is_an_error_that_says_so() {
        let root = tempfile::tempdir().unwrap();
        let link = root.path().join("link");
        std::os::unix::fs::symlink(root.path().join("none"), &link).unwrap();
        assert!(refusal(&link).contains("link to nothing"));
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
    fn if_one_file_cannot_be_moved_none_is() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("x.csv"), "old").unwrap();
        let mut output = Output::create(root.path()).unwrap();
        for name in ["w.csv", "x.csv", "y.csv"] {
            output.write(name, |w| writeln!(w, "new")).unwrap();
        }
        fs::create_dir(root.path().join("y.csv")).unwrap();
        assert!(output.commit().unwrap_err().to_string().contains("y.csv"));
        assert_eq!(names(root.path()), ["x.csv", "y.csv"]);
        assert_eq!(fs::read_to_string(root.path().join("x.csv")).unwrap(), "old");
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
