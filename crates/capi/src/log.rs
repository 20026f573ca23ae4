//! What the library has to say while it works.

use std::ffi::{CString, c_char, c_void};

use palpate::internal::gpu::{Level, Log};

use super::status::one_line;

/// What was chosen, and what was found in files and mended.
pub const PALPATE_LOG_NOTE: u32 = 0;
/// The validation layer's warnings.
pub const PALPATE_LOG_WARNING: u32 = 1;
/// The validation layer's errors.
pub const PALPATE_LOG_ERROR: u32 = 2;

/// Hears messages: PALPATE_LOG_*, and one line that lives until it returns. It is called on whatever thread a message comes up,
/// within a call of this library or of the driver's; it must not call the library, and must return: no longjmp, no exception.
pub type palpate_log = Option<unsafe extern "C" fn(user: *mut c_void, level: u32, message: *const c_char)>;

/// Who hears, and what it is told besides.
struct Ear {
    hear: unsafe extern "C" fn(*mut c_void, u32, *const c_char),
    user: *mut c_void,
}

// SAFETY: `user` is only passed on, and the header demands a function that may be called on any thread.
unsafe impl Send for Ear {}
// SAFETY: as above.
unsafe impl Sync for Ear {}

impl Ear {
    fn hear(&self, level: Level, message: &str) {
        let level = match level {
            Level::Note => PALPATE_LOG_NOTE,
            Level::Warning => PALPATE_LOG_WARNING,
            Level::Error => PALPATE_LOG_ERROR,
        };
        let line: CString = one_line(message);
        // SAFETY: the caller's function, as the header says.
        unsafe { (self.hear)(self.user, level, line.as_ptr()) };
    }
}

/// A log that a function of the caller's hears.
pub(super) fn to(hear: palpate_log, user: *mut c_void) -> Log {
    let Some(hear) = hear else { return Log::default() };
    let ear = Ear { hear, user };
    Log::new(move |level, message| ear.hear(level, message))
}
