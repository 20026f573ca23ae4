//! The one error type. Every variant says what went wrong, where, and what to do about it.

use std::path::{Path, PathBuf};

/// What can go wrong, by who can mend it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file the user named is missing, unreadable or malformed.
    #[error("{}{}: {problem}; {remedy}", .file.display(), .line.map(|l| format!(":{l}")).unwrap_or_default())]
    Input {
        /// The file.
        file: PathBuf,
        /// One-based line, where there is one.
        line: Option<usize>,
        /// What is wrong.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// A key of a scene, or an option, has a value that cannot be used.
    #[error("{}: `{key}`: {problem}; {remedy}", .file.display())]
    Key {
        /// The scene file.
        file: PathBuf,
        /// Dotted path of the key: `body.head.material.young`.
        key: String,
        /// What is wrong.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// The command line asks for what there is not; the message has the remedy.
    #[error("{0}")]
    Usage(String),
    /// A file could not be written.
    #[error("cannot write {}: {source}; make room, or choose another place", .file.display())]
    Output {
        /// The file or directory.
        file: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No Vulkan device can run palpate.
    #[error("{0}")]
    NoDevice(String),
    /// A Vulkan call failed.
    #[error("{call} failed in {stage}: {result}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// The stage of the step, or the part of the set-up.
        stage: String,
        /// Vulkan's result.
        result: String,
    },
    /// The device has no memory left for what was asked; the message has the remedy.
    #[error(
        "{0}; leave out bodies, make layers coarser (layer.cell) or skins smaller, or use a device with more memory"
    )]
    Memory(String),
    /// The simulation cannot go on.
    #[error("{0}")]
    Simulation(String),
    /// Who watched wanted it to end; the message says what.
    #[error("{0}")]
    Cancelled(String),
}

/// A result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Bad contents of a file.
    pub fn input(file: &Path, line: Option<usize>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Input { file: file.into(), line, problem: problem.into(), remedy: remedy.into() }
    }

    /// A bad value of a scene's key.
    pub fn key(file: &Path, key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Key { file: file.into(), key: key.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// The program's exit status: 2 bad input, 3 no usable device, 4 the simulation (or a device under it) failed.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::Input { .. } | Error::Key { .. } | Error::Usage(_) | Error::Output { .. } => 2,
            Error::NoDevice(_) => 3,
            Error::Vulkan { .. } | Error::Memory(_) | Error::Simulation(_) | Error::Cancelled(_) => 4,
        }
    }
}
