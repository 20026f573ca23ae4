//! The C ABI: what `palpate.h` declares, and nothing else.
//!
//! Every function checks what it is given, does its work under a guard that no panic leaves, and gives a status; what went
//! wrong is told by [`status::palpate_last_error`]. Handles are numbers in the clothes of pointers (`handles.rs`): nobody
//! follows them, so one that was destroyed, or never was, is found out. Structs carry their size as their user knew it
//! (`sized.rs`), so that they may grow.
//!
//! The header is generated from this room by cbindgen; `tests/ffi.rs` fails where the committed one differs.
#![allow(unsafe_code, non_camel_case_types)]
// What a caller must see to stands in the header's preface, once for all functions.
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

/// Number of the binary interface: raised when something that a program was compiled against changes its meaning or goes.
/// Compare it with `palpate_abi()`.
pub const PALPATE_ABI: u32 = 1;

/// The interface's number that the library was built with; differs from `PALPATE_ABI` where header and library do not belong
/// together.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_abi() -> u32 {
    PALPATE_ABI
}

/// The library's version, such as "0.1.0". Never null; lives as long as the program.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}
