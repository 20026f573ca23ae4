//! What every function gives, what went wrong in words, and the guard that keeps panics in.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use palpate::Error;

/// What became of a call. Whatever it is but PALPATE_STATUS_OK, nothing was changed but what the function says, and
/// `palpate_last_error` has one line that says what is wrong and what to do.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum palpate_status {
    /// Done.
    Ok = 0,
    /// A pointer or handle that must not be null is null.
    Null = 1,
    /// A handle that was destroyed, is of another kind, or never was.
    Handle = 2,
    /// A value that cannot be: not finite, out of range, a struct of unknown size.
    Argument = 3,
    /// The caller's array is too small; how many elements there are was told.
    TooSmall = 4,
    /// The handle is in use by another thread, or by the callback that makes this call.
    Busy = 5,
    /// A scene or a file that it names is wrong.
    Input = 6,
    /// A file could not be written.
    Output = 7,
    /// No Vulkan device can be used, or not the haptic one.
    NoDevice = 8,
    /// The device's memory does not suffice.
    Memory = 9,
    /// A Vulkan call failed.
    Vulkan = 10,
    /// The simulation cannot go on.
    Simulation = 11,
    /// A fault of the library's own. What it was at may only be destroyed.
    Fault = 12,
    /// The caller's callback ended it.
    Cancelled = 13,
}

/// Why a call did not do what it was asked to.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub status: palpate_status,
    pub message: String,
}

/// A result with [`Failure`].
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

/// What went wrong in the last call on this thread that did not give PALPATE_STATUS_OK, in one line; "" where none did. Never
/// null; lives until the next such call on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Does the work of a function; keeps what went wrong, and panics.
pub(super) fn guarded(work: impl FnOnce() -> Outcome) -> palpate_status {
    // What is at fault is behind a lock that the panic poisons.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => palpate_status::Ok,
        Ok(Err(failure)) => tell(failure),
        Err(panic) => tell(Failure::of_panic(&*panic)),
    }
}

/// A text in one line.
pub(super) fn one_line(text: &str) -> CString {
    let lines: Vec<&str> = text.split(['\n', '\0']).map(str::trim).filter(|line| !line.is_empty()).collect();
    CString::new(lines.join(" ")).unwrap_or_default()
}

fn tell(Failure { status, message }: Failure) -> palpate_status {
    let line = one_line(&message);
    // At the very end of a thread there is no place for it any more.
    let _ = LAST.try_with(|last| *last.borrow_mut() = line);
    status
}

impl Failure {
    /// What a panic says.
    pub fn of_panic(panic: &(dyn Any + Send)) -> Failure {
        Failure::new(palpate_status::Fault, format!("a fault of palpate's own: {}", words(panic)))
    }
}

fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it says nothing")
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn last() -> String {
        // SAFETY: never null, and ends in a zero.
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
