//! The crate's one error type. Every variant says what went wrong, where, and what to do about it.

use std::path::{Path, PathBuf};

/// What can go wrong; the variants differ in who can mend it: the user's input, the machine, or the simulation.
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
    /// The command line or a call asks for something that does not exist or cannot be done; the message has the remedy.
    #[error("{0}")]
    Usage(String),
    /// A file could not be written.
    #[error("cannot write {}: {source}; free disk space, or choose another folder", .file.display())]
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
        /// Name of the Vulkan call.
        call: &'static str,
        /// The stage of the step, or the part of the set-up, that made the call.
        stage: String,
        /// The VkResult, as text.
        result: String,
    },
    /// The GPU's memory, or the largest array it allows, is too small for what was asked; the message has the remedy.
    #[error(
        "{0}; leave out bodies, make layers coarser (layer.cell) or skins smaller, or use a device with more memory"
    )]
    Memory(String),
    /// The simulation cannot go on.
    #[error("{0}")]
    Simulation(String),
    /// The caller's progress callback ended the work; the message says where.
    #[error("{0}")]
    Cancelled(String),
}

/// A result whose error is [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An error in the contents of a file.
    pub fn input(file: &Path, line: Option<usize>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Input { file: file.into(), line, problem: problem.into(), remedy: remedy.into() }
    }

    /// An error in the value of a scene's key.
    pub fn key(file: &Path, key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Key { file: file.into(), key: key.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// The program's exit status: 2 bad input or output, 3 no usable GPU, 4 the simulation (or the GPU under it) failed
    /// or was cancelled.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::Input { .. } | Error::Key { .. } | Error::Usage(_) | Error::Output { .. } => 2,
            Error::NoDevice(_) => 3,
            Error::Vulkan { .. } | Error::Memory(_) | Error::Simulation(_) | Error::Cancelled(_) => 4,
        }
    }
}
