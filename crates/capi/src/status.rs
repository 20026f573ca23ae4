//! The status that every function returns, the message of the last failure, and the guard that catches panics.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use palpate::Error;

/// Result of a call. With any status but PALPATE_STATUS_OK the call changed nothing, unless its description says
/// otherwise, and `palpate_last_error` returns one line that describes the error and what to do about it.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum palpate_status {
    /// The call succeeded.
    Ok = 0,
    /// A pointer or handle that must not be null is null.
    Null = 1,
    /// A handle was destroyed, is of another kind, or was never made.
    Handle = 2,
    /// A value is not allowed: it is not finite or out of range, or a struct has a wrong size.
    Argument = 3,
    /// The caller's array is too small; the call returned how many elements there are.
    TooSmall = 4,
    /// The handle is in use by another thread, or by the callback that makes this call.
    Busy = 5,
    /// A scene or a file that it names is wrong.
    Input = 6,
    /// A file could not be written.
    Output = 7,
    /// No Vulkan device can be used, or the haptic device does not open.
    NoDevice = 8,
    /// The memory of the Vulkan device does not suffice, or a thread cannot be started.
    Memory = 9,
    /// A Vulkan call failed.
    Vulkan = 10,
    /// The simulation cannot go on.
    Simulation = 11,
    /// A fault of the library itself. The object that the call worked on may only be destroyed.
    Fault = 12,
    /// The caller's callback cancelled the call.
    Cancelled = 13,
}

/// Why a call failed: the status that it returns, and the message for `palpate_last_error`.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub status: palpate_status,
    pub message: String,
}

/// Result type of this crate's functions, with [`Failure`] as the error.
pub(super) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    pub fn new(status: palpate_status, message: impl Into<String>) -> Failure {
        Failure { status, message: message.into() }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let status = match &error {
            Error::Input { .. } | Error::Key { .. } | Error::Usage(_) => palpate_status::Input,
            Error::Output { .. } => palpate_status::Output,
            Error::NoDevice(_) => palpate_status::NoDevice,
            Error::Vulkan { .. } => palpate_status::Vulkan,
            Error::Memory(_) => palpate_status::Memory,
            Error::Simulation(_) => palpate_status::Simulation,
            Error::Cancelled(_) => palpate_status::Cancelled,
        };
        Failure::new(status, error.to_string())
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Returns the message of the last call on this thread that did not return PALPATE_STATUS_OK, in one line; "" if there
/// was none. The string is never null, and is valid until the next call on this thread that fails.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Runs the body of an exported function: catches its panics, stores the message of a failure for
/// [`palpate_last_error`], and returns the status.
pub(super) fn guarded(work: impl FnOnce() -> Outcome) -> palpate_status {
    // Unwind safety: an object that a panic leaves half-changed is behind a lock, which the panic poisons.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => palpate_status::Ok,
        Ok(Err(failure)) => tell(failure),
        Err(panic) => tell(Failure::of_panic(&*panic)),
    }
}

/// Joins the lines of a text into one, without zero characters.
pub(super) fn one_line(text: &str) -> CString {
    let lines: Vec<&str> = text.split(['\n', '\0']).map(str::trim).filter(|line| !line.is_empty()).collect();
    CString::new(lines.join(" ")).unwrap_or_default()
}

fn tell(Failure { status, message }: Failure) -> palpate_status {
    let line = one_line(&message);
    // While a thread ends, its thread-local storage may be gone already: then the message is lost.
    let _ = LAST.try_with(|last| *last.borrow_mut() = line);
    status
}

impl Failure {
    /// Returns the failure that reports a panic, with the panic's message.
    pub fn of_panic(panic: &(dyn Any + Send)) -> Failure {
        Failure::new(palpate_status::Fault, format!("internal error of palpate: {}", words(panic)))
    }
}

fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn last() -> String {
        // SAFETY: the library's message is never null and is terminated by a zero.
        unsafe { CStr::from_ptr(palpate_last_error()) }.to_string_lossy().into()
    }

    #[test]
    fn panics_stay_inside_and_each_thread_has_its_own_message() {
        assert_eq!(guarded(|| panic!("a wheel came off")), palpate_status::Fault);
        assert!(last().contains("a wheel came off"), "{}", last());
        std::thread::spawn(|| assert_eq!(last(), "")).join().unwrap();
        let failed = || Err(Failure::new(palpate_status::Argument, "a\0b\n  c"));
        assert_eq!(guarded(failed), palpate_status::Argument);
        assert_eq!(last(), "a b c");
        assert_eq!(guarded(|| Ok(())), palpate_status::Ok);
        assert_eq!(last(), "a b c");
    }
}
