//! Messages of the engine for programs that embed it: a [`Log`] passes each message to a function of the program.

use std::sync::Arc;

use crate::error::printable;

/// Severity of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Information: choices that the engine made, and defects of meshes that it found and repaired.
    Note,
    /// A warning of Vulkan's validation layer.
    Warning,
    /// An error reported by Vulkan's validation layer.
    Error,
}

type Hear = dyn Fn(Level, &str) + Send + Sync;

/// Passes messages, each of one or several lines, to the receiver: a function of the embedding program, which is called
/// on the thread that causes the message. Without a receiver, messages are discarded.
#[derive(Clone, Default)]
pub struct Log(Option<Arc<Hear>>);

impl Log {
    /// Makes a log whose receiver is `hear`.
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
            hear(level, &printable(message));
        }
    }
}

impl std::fmt::Debug for Log {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Log({})", if self.is_heard() { "heard" } else { "unheard" })
    }
}
