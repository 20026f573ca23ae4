//! Passes messages of the library on to the log callback that a C program, which uses the library by the header
//! palpate.h, gives when it opens a Vulkan device. Messages report what the library chose, which defects of files it
//! repaired, and what the Vulkan validation layer (a checker of Vulkan calls) found.

use std::ffi::{CString, c_char, c_void};

use palpate::internal::gpu::{Level, Log};

use super::status::one_line;

/// Level of a message: a note about what the library chose, or about defects of files that it repaired.
pub const PALPATE_LOG_NOTE: u32 = 0;
/// Level of a message: a warning of the Vulkan validation layer.
pub const PALPATE_LOG_WARNING: u32 = 1;
/// Level of a message: an error of the Vulkan validation layer.
pub const PALPATE_LOG_ERROR: u32 = 2;

/// Log callback: receives `user`, the pointer that was given along with the callback; `level`, one of PALPATE_LOG_*;
/// and `message`, one line of text that is valid until the callback returns. The callback may be called on any thread,
/// within a call of this library or of the Vulkan driver. It must not call the library, and must return normally, not
/// by longjmp or an exception.
pub type palpate_log = Option<unsafe extern "C" fn(user: *mut c_void, level: u32, message: *const c_char)>;

/// The caller's log callback (`hear`), and the pointer that is passed to it at each call (`user`).
struct Ear {
    hear: unsafe extern "C" fn(*mut c_void, u32, *const c_char),
    user: *mut c_void,
}

// SAFETY: the library only passes `user` on to the callback, which must accept calls on any thread (palpate.h).
unsafe impl Send for Ear {}
// SAFETY: the library only passes `user` on to the callback, which must accept calls on any thread (palpate.h).
unsafe impl Sync for Ear {}

impl Ear {
    fn hear(&self, level: Level, message: &str) {
        let level = match level {
            Level::Note => PALPATE_LOG_NOTE,
            Level::Warning => PALPATE_LOG_WARNING,
            Level::Error => PALPATE_LOG_ERROR,
        };
        let line: CString = one_line(message);
        // SAFETY: palpate.h demands a callback that may be called with this `user`; `line` lives until the call
        // returns.
        unsafe { (self.hear)(self.user, level, line.as_ptr()) };
    }
}

/// Makes a log that passes messages on to the caller's callback `hear`; if the callback is null, it discards them.
pub(super) fn to(hear: palpate_log, user: *mut c_void) -> Log {
    let Some(hear) = hear else { return Log::default() };
    let ear = Ear { hear, user };
    Log::new(move |level, message| ear.hear(level, message))
}
