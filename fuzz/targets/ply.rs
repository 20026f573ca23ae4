//! Surfaces: PLY files, ASCII and binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::surface;

fuzz_target!(|bytes: &[u8]| surface("mesh.ply", bytes));
