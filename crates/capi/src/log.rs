//! Messages of the library (choices, repairs, messages of the Vulkan validation layer), passed on to the caller's log
//! callback.

use std::ffi::{CString, c_char, c_void};

use palpate::internal::gpu::{Level, Log};

use super::status::one_line;

/// Level of a message: a note about what was chosen, or about defects of files that were repaired.
pub const PALPATE_LOG_NOTE: u32 = 0;
/// Level of a message: a warning of the Vulkan validation layer.
pub const PALPATE_LOG_WARNING: u32 = 1;
/// Level of a message: an error of the Vulkan validation layer.
pub const PALPATE_LOG_ERROR: u32 = 2;

/// Log callback: receives a level (PALPATE_LOG_*) and a message of one line that is valid until the callback returns.
/// It is called on any thread, within a call of this library or of the Vulkan driver. It must not call the library, and
/// must return: no longjmp, no exception.
pub type palpate_log = Option<unsafe extern "C" fn(user: *mut c_void, level: u32, message: *const c_char)>;

/// The caller's log callback with the `user` that is passed to it.
struct Ear {
    hear: unsafe extern "C" fn(*mut c_void, u32, *const c_char),
    user: *mut c_void,
}

// SAFETY: the library only passes `user` on, and the header demands a function that may be called on any thread.
unsafe impl Send for Ear {}
// SAFETY: as for `Send`, just above.
unsafe impl Sync for Ear {}

impl Ear {
    fn hear(&self, level: Level, message: &str) {
        let level = match level {
            Level::Note => PALPATE_LOG_NOTE,
            Level::Warning => PALPATE_LOG_WARNING,
            Level::Error => PALPATE_LOG_ERROR,
        };
        let line: CString = one_line(message);
        // SAFETY: the header demands a function that may be called with this `user`; the line lives until it returns.
        unsafe { (self.hear)(self.user, level, line.as_ptr()) };
    }
}

/// A log that passes messages on to the caller's callback; null: they are discarded.
pub(super) fn to(hear: palpate_log, user: *mut c_void) -> Log {
    let Some(hear) = hear else { return Log::default() };
    let ear = Ear { hear, user };
    Log::new(move |level, message| ear.hear(level, message))
}
