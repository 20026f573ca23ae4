//! The error type of the whole crate. Its messages name what went wrong and where, and what the user can do about it.

use std::borrow::Cow;
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What can go wrong. The cause may be the user's input or output (`Input`, `Key`, `Usage`, `Output`), the machine
/// (`NoDevice`, `Vulkan`, `Memory`), or the simulation (`Simulation`, `Cancelled`).
#[derive(Debug)]
pub enum Error {
    /// A file that the user named is missing, unreadable or malformed.
    Input {
        /// The file.
        file: PathBuf,
        /// Number of the faulty line, from 1; `None` where the error is not in a single line.
        line: Option<usize>,
        /// What is wrong.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// A key of a scene file, or an option, has a value that cannot be used.
    Key {
        /// The scene file.
        file: PathBuf,
        /// Dotted path of the key, such as `body.head.material.young`.
        key: String,
        /// What is wrong.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// The command line or a call asks for something that does not exist or cannot be done; the message includes the
    /// remedy.
    Usage(String),
    /// A file could not be written.
    Output {
        /// The file or directory.
        file: PathBuf,
        /// The error that the operating system returned.
        source: std::io::Error,
    },
    /// No Vulkan device can run palpate.
    NoDevice(String),
    /// A Vulkan call failed.
    Vulkan {
        /// Name of the Vulkan call.
        call: &'static str,
        /// The stage of the step, or the part of the set-up, that made the call.
        stage: String,
        /// The error code that the call returned (VkResult), as text.
        result: String,
    },
    /// The GPU's memory, or the largest array that the GPU allows, is too small for the scene; the message includes the
    /// remedy.
    Memory(String),
    /// The simulation cannot go on.
    Simulation(String),
    /// The caller's progress callback cancelled the work; the message names the stage that was reached.
    Cancelled(String),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self {
            Error::Input { file, line, problem, remedy } => {
                let line = line.map(|line| format!(":{line}")).unwrap_or_default();
                format!("{}{line}: {problem}; {remedy}", file.display())
            }
            Error::Key { file, key, problem, remedy } => format!("{}: `{key}`: {problem}; {remedy}", file.display()),
            Error::Output { file, source } => {
                let remedy = match source.kind() {
                    ErrorKind::NotFound => "make its folder first",
                    ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                        "give a folder that you may write to"
                    }
                    ErrorKind::InvalidInput => "write into another folder",
                    ErrorKind::AlreadyExists | ErrorKind::NotADirectory | ErrorKind::IsADirectory => {
                        "give another name"
                    }
                    _ => "free disk space, or choose another folder",
                };
                format!("cannot write {}: {source}; {remedy}", file.display())
            }
            Error::Vulkan { call, stage, result } => format!("{call} failed in {stage}: {result}"),
            Error::Memory(what) => format!(
                "{what}; leave out bodies, use coarser layers (a larger layer.cell) or smaller skins, or a device with \
                 more memory"
            ),
            Error::Usage(what) | Error::NoDevice(what) | Error::Simulation(what) | Error::Cancelled(what) => {
                what.clone()
            }
        };
        let text = printable(&text);
        match self {
            // These quote files, keys and their values, which may contain anything.
            Error::Input { .. } | Error::Key { .. } | Error::Output { .. } => f.write_str(&text.replace('\n', "\\n")),
            _ => f.write_str(&text),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Output { source, .. } => Some(source),
            _ => None,
        }
    }
}

/// A text without the characters that a terminal obeys instead of showing them: control characters but for ends of
/// lines and tabs, and those that reverse the direction of writing. They appear as escapes such as `\u{1b}`, since the
/// text may quote names and contents of files that nobody has looked at.
pub fn printable(text: &str) -> Cow<'_, str> {
    let obeyed = |c: char| {
        c.is_control() && !matches!(c, '\n' | '\t') || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let shown = |c: char| if obeyed(c) { c.escape_unicode().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(shown).collect())
}

/// A result whose error is [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Every exit status of the program, with its meaning.
    #[doc(hidden)]
    pub const EXIT_STATUSES: [(u8, &str); 4] = [
        (0, "success"),
        (
            2,
            "bad input, or output that cannot be written: one line names the file, line, key or option, and the remedy",
        ),
        (3, "no usable Vulkan device"),
        (
            4,
            "the simulation or its Vulkan device failed, memory did not suffice, a run was interrupted, a replay differs, \
             a comparison is worse than before, a case of `stability` fails silently, or a value of `validate` is not \
             reproduced",
        ),
    ];

    /// An [`Error::Input`]: an error in the contents of a file.
    pub fn input(file: &Path, line: Option<usize>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Input { file: file.into(), line, problem: problem.into(), remedy: remedy.into() }
    }

    /// An [`Error::Key`]: an error in the value of a scene's key or of an option.
    pub fn key(file: &Path, key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Key { file: file.into(), key: key.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// Exit status of a program that ends with this error: 2 for bad input or output, 3 for no usable GPU, 4 for a
    /// simulation that failed (or whose GPU failed) or was cancelled.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::Input { .. } | Error::Key { .. } | Error::Usage(_) | Error::Output { .. } => 2,
            Error::NoDevice(_) => 3,
            Error::Vulkan { .. } | Error::Memory(_) | Error::Simulation(_) | Error::Cancelled(_) => 4,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_message_moves_the_cursor_or_changes_colours_of_a_terminal() {
        let hostile = "a\u{1b}[31m\u{7}\u{202e}b";
        let file = PathBuf::from(hostile);
        let output = Error::Output { file: file.clone(), source: std::io::ErrorKind::NotFound.into() };
        let errors = [
            Error::input(&file, Some(1), hostile, hostile),
            Error::key(&file, hostile, hostile, hostile),
            Error::Usage(hostile.into()),
            output,
        ];
        for error in errors {
            let text = error.to_string();
            assert!(text.contains("a\\u{1b}[31m\\u{7}\\u{202e}b") && !text.contains(char::is_control), "{text:?}");
        }
        let quoted = Error::key(&file, "surface", "there is no file a\nb", "correct it").to_string();
        assert!(quoted.contains("no file a\\nb"), "an error of a file is not one line: {quoted}");
        assert_eq!(printable("two\n\tlines: \u{e9}"), "two\n\tlines: \u{e9}");
    }

    #[test]
    fn every_error_has_a_listed_exit_status() {
        let file = PathBuf::new;
        let errors = [
            Error::Input { file: file(), line: None, problem: String::new(), remedy: String::new() },
            Error::Key { file: file(), key: String::new(), problem: String::new(), remedy: String::new() },
            Error::Usage(String::new()),
            Error::Output { file: file(), source: std::io::ErrorKind::Other.into() },
            Error::NoDevice(String::new()),
            Error::Vulkan { call: "", stage: String::new(), result: String::new() },
            Error::Memory(String::new()),
            Error::Simulation(String::new()),
            Error::Cancelled(String::new()),
        ];
        let mut listed: Vec<u8> = Error::EXIT_STATUSES.iter().map(|(status, _)| *status).collect();
        listed.retain(|status| *status != 0);
        let mut raised: Vec<u8> = errors.iter().map(Error::exit_status).collect();
        raised.dedup();
        assert_eq!(raised, listed);
    }
}
