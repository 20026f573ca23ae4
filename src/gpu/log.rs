//! Messages of the engine for programs that embed it.

use std::sync::Arc;

/// Severity of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Information: choices that the engine made, and defects that it found and repaired in meshes.
    Note,
    /// The validation layer's warnings.
    Warning,
    /// The validation layer's errors.
    Error,
}

type Hear = dyn Fn(Level, &str) + Send + Sync;

/// Receives messages, each of one or several lines, on the thread that causes them; without a receiver they are
/// discarded.
#[derive(Clone, Default)]
pub struct Log(Option<Arc<Hear>>);

impl Log {
    /// A log whose messages go to this function.
    pub fn new(hear: impl Fn(Level, &str) + Send + Sync + 'static) -> Log {
        Log(Some(Arc::new(hear)))
    }

    /// Whether the log has a receiver.
    pub fn is_heard(&self) -> bool {
        self.0.is_some()
    }

    /// Passes a message to the receiver, if there is one.
    pub fn tell(&self, level: Level, message: &str) {
        if let Some(hear) = &self.0 {
            hear(level, message);
        }
    }
}

impl std::fmt::Debug for Log {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Log({})", if self.is_heard() { "heard" } else { "unheard" })
    }
}
