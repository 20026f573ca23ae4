//! What the engine has to say while it works, for programs that embed it.

use std::sync::Arc;

/// How much a message matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// What was chosen, and what was found and mended.
    Note,
    /// The validation layer's warnings.
    Warning,
    /// The validation layer's errors.
    Error,
}

type Hear = dyn Fn(Level, &str) + Send + Sync;

/// Hears messages, one line or several each, on whatever thread they come up.
#[derive(Clone, Default)]
pub struct Log(Option<Arc<Hear>>);

impl Log {
    /// Told to a function.
    pub fn new(hear: impl Fn(Level, &str) + Send + Sync + 'static) -> Log {
        Log(Some(Arc::new(hear)))
    }

    /// Whether anybody hears.
    pub fn is_heard(&self) -> bool {
        self.0.is_some()
    }

    /// Says something.
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
