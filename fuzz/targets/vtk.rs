//! Tetrahedral meshes: legacy VTK files, ASCII and binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::layer;

fuzz_target!(|bytes: &[u8]| layer("mesh.vtk", bytes));
