//! The status that the functions of the C interface return, the message of the last failed call, and the guard that
//! catches panics. A handle is a number by which the caller of the C interface names an object of the library.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use palpate::Error;

/// Result of a call. If a call returns another status than PALPATE_STATUS_OK, it changed nothing, unless the
/// description of the function says otherwise, and `palpate_last_error` returns one line that describes the error and
/// what to do about it.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum palpate_status {
    /// The call succeeded.
    Ok = 0,
    /// A pointer or handle that must not be null is null.
    Null = 1,
    /// A handle is no valid handle of the required kind: it was destroyed, was never created, or stands for an object
    /// of another kind.
    Handle = 2,
    /// A value is not allowed: it is not finite or out of range, or a struct has a wrong size.
    Argument = 3,
    /// An array of the caller is too small; the call wrote the number of elements that it needs to the caller's
    /// variable for that number.
    TooSmall = 4,
    /// The object of a handle is in use by another call, a submitted step (for which its caller does not wait) or a
    /// haptic loop; or a callback called a function that would wait for the callback's own loop.
    Busy = 5,
    /// A scene, or a file that a scene names, has an error.
    Input = 6,
    /// A file could not be written.
    Output = 7,
    /// No Vulkan device can be used, or the haptic device cannot be opened.
    NoDevice = 8,
    /// The memory of the Vulkan device does not suffice, or a thread cannot be started.
    Memory = 9,
    /// A Vulkan call failed.
    Vulkan = 10,
    /// The simulation can do no further step.
    Simulation = 11,
    /// The library itself has a fault. The object on which the call worked may only be destroyed.
    Fault = 12,
    /// The caller's callback cancelled the call.
    Cancelled = 13,
}

/// Failure of a call: the status that the call returns, and the message that `palpate_last_error` returns.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub status: palpate_status,
    pub message: String,
}

/// Result type of the functions of this crate; the error is a [`Failure`].
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

/// Returns the message of the last failed call on this thread, that is, the last call with another status than
/// PALPATE_STATUS_OK. The message is one line, or "" if no call has failed. The string is never null, and is valid
/// until the next call on this thread fails.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Runs the body of an exported function: catches its panics, stores the message of a failure for
/// [`palpate_last_error`], and returns the status.
pub(super) fn guarded(work: impl FnOnce() -> Outcome) -> palpate_status {
    // Unwind safety: if a panic leaves an object half-changed, it also poisons the lock of this object.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => palpate_status::Ok,
        Ok(Err(failure)) => tell(failure),
        Err(panic) => tell(Failure::of_panic(&*panic)),
    }
}

/// Joins the lines of a text to one line without zero characters.
pub(super) fn one_line(text: &str) -> CString {
    let lines: Vec<&str> = text.split(['\n', '\0']).map(str::trim).filter(|line| !line.is_empty()).collect();
    CString::new(lines.join(" ")).unwrap_or_default()
}

fn tell(Failure { status, message }: Failure) -> palpate_status {
    let line = one_line(&message);
    // While a thread ends, its thread-local storage may already be gone; in that case the message is lost.
    let _ = LAST.try_with(|last| *last.borrow_mut() = line);
    status
}

impl Failure {
    /// Returns the failure with which a call reports a panic; it contains the message of the panic.
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
        // SAFETY: the library's message is never null and is terminated by a zero byte.
        unsafe { CStr::from_ptr(palpate_last_error()) }.to_string_lossy().into()
    }

    #[test]
    fn panics_stay_inside_and_each_thread_has_its_own_message() {
        assert_eq!(guarded(|| panic!("a wheel came off")), palpate_status::Fault);
        assert!(last().contains("a wheel came off"), "wrong error: {}", last());
        std::thread::spawn(|| assert_eq!(last(), "")).join().unwrap();
        let failed = || Err(Failure::new(palpate_status::Argument, "a\0b\n  c"));
        assert_eq!(guarded(failed), palpate_status::Argument);
        assert_eq!(last(), "a b c");
        assert_eq!(guarded(|| Ok(())), palpate_status::Ok);
        assert_eq!(last(), "a b c");
    }
}
