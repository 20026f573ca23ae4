//! The C ABI of palpate: this crate exports the functions and structs that `palpate.h` declares, and nothing else.
//!
//! Every function checks its arguments, works under a guard that catches panics (`status.rs`), and returns a status;
//! [`status::palpate_last_error`] returns the message of the last failure on a thread. A handle is a number in the form
//! of an opaque pointer that nobody dereferences (`handles.rs`), so a handle that was destroyed, or was never created,
//! is detected. Most structs begin with their size as the caller was compiled with it (`sized.rs`), so that later
//! versions can add fields.
//!
//! cbindgen generates the header from this crate (`cbindgen.toml`); `tests/ffi.rs` fails where the committed header
//! differs.
#![allow(unsafe_code, non_camel_case_types)]
// The conditions that a C caller must keep are written once for all functions, at the top of palpate.h
// (`cbindgen.toml`).
#![allow(clippy::missing_safety_doc)]

pub mod build;
pub mod change;
pub mod context;
pub mod describe;
mod handles;
pub mod haptic_device;
pub mod haptic_loop;
pub mod host;
pub mod log;
pub mod loop_options;
pub mod loop_state;
pub mod scene;
pub mod shown;
pub mod simulation;
mod sized;
pub mod state;
pub mod statistics;
pub mod status;
pub mod steps;
mod tables;

use std::ffi::c_char;

/// Version number of the binary interface. It is raised when something that a compiled program relies on changes its
/// meaning or is removed. Compare it with `palpate_abi()`.
pub const PALPATE_ABI: u32 = 1;

/// Returns the `PALPATE_ABI` that the library was built with. It differs from the value in the header if the header is
/// not that of the library.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_abi() -> u32 {
    PALPATE_ABI
}

/// Returns the library's version, such as "0.1.0". The string is never null and is valid as long as the program runs.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}
