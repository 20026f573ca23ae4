//! The C ABI of palpate, a GPU engine for haptic touch of soft bodies: this crate exports the functions and structs
//! that the header `palpate.h` declares, and nothing else.
//!
//! Every function that can fail checks its arguments, runs under a guard that catches panics (`status.rs`), and returns
//! a status; [`status::palpate_last_error`] returns the message of the last failed call on the calling thread. A handle
//! is a number in the form of an opaque pointer that nobody dereferences (`handles.rs`), so the use of a handle that
//! was destroyed, or was never created, is detected. The first field of most structs is the struct's size in the header
//! with which the caller was compiled (`sized.rs`), so that later versions of the library can add fields.
//!
//! The tool cbindgen generates the header from this crate, with the settings in `cbindgen.toml`; the test
//! `tests/ffi.rs` fails if the committed header differs from the generated one.
#![allow(unsafe_code, non_camel_case_types)]
// The conditions that a C caller must keep are the same for all functions. They are written once, in the comment at the
// top of palpate.h, whose text is in `cbindgen.toml`.
#![allow(clippy::missing_safety_doc)]

mod handles;
mod sized;
mod tables;

// The header has the functions in this order, which is that of their use. Blank lines keep it: the formatter sorts what
// stands together.
pub mod status;

pub mod log;

pub mod context;

pub mod host;

pub mod scene;

pub mod describe;

pub mod build;

pub mod simulation;

pub mod steps;

pub mod state;

pub mod statistics;

pub mod change;

pub mod shown;

pub mod haptic_device;

pub mod loop_options;

pub mod haptic_loop;

pub mod loop_state;

use std::ffi::c_char;

/// Version number of the binary interface that palpate.h declares. It is raised when something that a compiled program
/// relies on changes its meaning or is removed. A program should compare it with the result of `palpate_abi()`.
pub const PALPATE_ABI: u32 = 1;

/// Returns the value of `PALPATE_ABI` with which the library was built. If it differs from the value in the header with
/// which a program was compiled, the program must not use this library.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_abi() -> u32 {
    PALPATE_ABI
}

/// Returns the version of the library, such as "0.1.0". The string is never null and is valid as long as the program
/// runs.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}
